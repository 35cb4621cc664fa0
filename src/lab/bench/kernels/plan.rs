//! Case of `plan`: dispatch sizes from counts that only the device knows.

use super::KernelCase;
use crate::Result;
use crate::gpu::{Gpu, Groups};
use crate::kernels::plan::{Bindings, Params, Plan};
use crate::lab::bench::Work;
use crate::lab::bench::check::words;
use crate::layout::*;

/// Counts of a frame, slot by slot.
pub type Counts = [u32; COUNT_SLOTS as usize];

/// Dispatch arguments of a frame, slot by slot.
pub type Args = [DispatchArgs; ARGS_SLOTS as usize];

/// Parameters of a usual frame, at its first stage.
pub const PARAMS: Params = Params {
    stage: 0,
    isect_capacity: 1_000_000,
    chunk: 1024,
    chunks_per_group: 8,
    digit_count: 256,
    workgroup: 64,
    scanned_per_group: 32,
    group_limit: 65_535,
    tile_count: 1020,
    band: 0,
    band_count: 1,
    rank_limit: u32::MAX,
};

/// A usual number of visible splats. One invocation: a frame's price for sizes that only the device knows.
pub fn usual<'a>(gpu: &Gpu) -> Result<KernelCase<'a, Plan>> {
    let mut counts = [0; COUNT_SLOTS as usize];
    counts[COUNT_VISIBLE as usize] = 123_457;
    plan(gpu, &PARAMS, &counts, &[0])
}

/// Counts before, and the first intersection of each visible splat.
pub fn plan<'a>(gpu: &Gpu, params: &Params, before: &Counts, isect_from_rank: &[u32]) -> Result<KernelCase<'a, Plan>> {
    let params = *params;
    let untouched = [DispatchArgs { x: 9, y: 9, z: 9 }; ARGS_SLOTS as usize];
    let (mut counts, mut planned) = (*before, untouched);
    expected(&mut counts, &mut planned, &params);
    let counts_before = gpu.buffer_from("counts", before)?;
    let args_before = gpu.buffer_from("args", &untouched)?;
    let counts_after = gpu.buffer::<u32>("counts", before.len())?;
    let args = gpu.buffer::<DispatchArgs>("args", untouched.len())?;
    let begins = gpu.buffer_from("isect_from_rank", isect_from_rank)?;
    let case = KernelCase::new(Work::default())
        .exact("counts", &counts_after, words(&counts))
        .exact("args", &args, words(&planned))
        .copy(&counts_before, &counts_after)
        .copy(&args_before, &args);
    Ok(case.commands(move |rec, kernel: &Plan, _| {
        let io = Bindings {
            counts: &counts_after,
            args: &args,
            isect_from_rank: &begins,
        };
        kernel.record(rec, io, params, Groups::Count(1));
    }))
}

/// `count` workgroups, no more than `limit` in one dimension.
fn folded(count: u64, limit: u32) -> DispatchArgs {
    let x = count.min(u64::from(limit));
    let y = if x == 0 { 0 } else { count.div_ceil(x) };
    DispatchArgs {
        x: x as u32,
        y: y as u32,
        z: 1,
    }
}

/// Chunks of a sort: the largest even number of whole workgroups of chunks of at least `chunk` keys, but two of them.
fn chunks(count: u64, params: &Params) -> u64 {
    let pair = 2 * u64::from(params.chunks_per_group);
    match count {
        0 => 0,
        _ => pair * (count / (pair * u64::from(params.chunk))).max(1),
    }
}

/// Counts and arguments after a frame's first band, by wide integers.
fn expected(counts: &mut Counts, args: &mut Args, params: &Params) {
    let failed = COUNT_FAILED as usize;
    let (main, elementwise, [by_chunk, by_table]) = if params.stage == 0 {
        let others = [ARGS_VISIBLE_CHUNK, ARGS_VISIBLE_TABLE];
        (COUNT_VISIBLE as usize, ARGS_VISIBLE, others)
    } else {
        let wanted = counts[COUNT_ISECT as usize];
        if counts[failed] == 0 {
            counts[COUNT_ISECT_WANTED as usize] = wanted;
        }
        counts[failed] = u32::from(counts[failed] != 0 || wanted > params.isect_capacity);
        let others = [ARGS_ISECT_CHUNK, ARGS_ISECT_TABLE];
        (COUNT_ISECT as usize, ARGS_ISECT, others)
    };
    if counts[failed] != 0 {
        counts[main] = 0;
    }
    let count = u64::from(counts[main]);
    let groups = |elements: u64| elements.div_ceil(u64::from(params.workgroup));
    let scan = |elements: u64| {
        elements
            .div_ceil(u64::from(SCAN_CHUNK))
            .div_ceil(u64::from(params.scanned_per_group))
    };
    let chunks = chunks(count, params);
    let table = chunks * u64::from(params.digit_count);
    counts[main + 1] = chunks as u32;
    counts[main + 2] = table as u32;
    let mut set = |slot: u32, groups: u64| args[slot as usize] = folded(groups, params.group_limit);
    set(elementwise, groups(count));
    set(by_chunk, chunks.div_ceil(u64::from(params.chunks_per_group)));
    set(by_table, scan(table));
    if params.stage == 0 {
        set(ARGS_VISIBLE_SCAN, scan(count));
    } else {
        let visible = u64::from(counts[COUNT_VISIBLE as usize]);
        set(ARGS_EXPAND, if count == 0 { 0 } else { groups(visible) });
        set(ARGS_TILE, u64::from(params.tile_count) * visible.min(1));
        counts[COUNT_BAND_BEGIN as usize] = 0;
        counts[COUNT_BAND_END as usize] = visible as u32;
        counts[COUNT_BAND_BASE as usize] = match visible {
            0 => counts[COUNT_ISECT_WANTED as usize],
            _ => 0,
        };
    }
}
