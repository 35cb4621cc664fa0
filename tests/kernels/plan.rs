//! Dispatch sizes and overflow, by wide integers.

use crate::check::*;
use crate::{device, supported};
use ashfall::kernels::plan::{Bindings, Choice, Params, Plan};
use ashfall::layout::*;

const PARAMS: Params = Params {
    stage: 0,
    isect_capacity: 1_000_000,
    chunk: 1024,
    chunks_per_group: 8,
    digit_count: 256,
    workgroup: 64,
    group_limit: 65_535,
};

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

/// What `plan` should leave, by its slots: visible or intersections, chunks, table; then the arguments.
fn expected(counts: &mut [u32; 16], args: &mut [DispatchArgs; 8], params: &Params) {
    let failed = COUNT_FAILED as usize;
    let (main, elementwise, others) = if params.stage == 0 {
        let others = [ARGS_VISIBLE_CHUNK, ARGS_VISIBLE_TABLE];
        (COUNT_VISIBLE as usize, ARGS_VISIBLE as usize, others)
    } else {
        let wanted = counts[COUNT_ISECT as usize];
        if counts[failed] == 0 {
            counts[COUNT_ISECT_WANTED as usize] = wanted;
        }
        counts[failed] = u32::from(counts[failed] != 0 || wanted > params.isect_capacity);
        let others = [ARGS_ISECT_CHUNK, ARGS_ISECT_TABLE];
        (COUNT_ISECT as usize, ARGS_ISECT as usize, others)
    };
    if counts[failed] != 0 {
        counts[main] = 0;
    }
    let count = u64::from(counts[main]);
    let groups = |elements: u64| elements.div_ceil(u64::from(params.workgroup));
    let chunks = count.div_ceil(u64::from(params.chunk));
    let table = chunks * u64::from(params.digit_count);
    let scan = |elements: u64| groups(elements.div_ceil(u64::from(SCAN_CHUNK)));
    counts[main + 1] = chunks as u32;
    counts[main + 2] = table as u32;
    let mut set = |slot: u32, groups: u64| args[slot as usize] = folded(groups, params.group_limit);
    set(elementwise as u32, groups(count));
    set(
        others[0],
        chunks.div_ceil(u64::from(params.chunks_per_group)),
    );
    set(others[1], scan(table));
    if params.stage == 0 {
        set(ARGS_VISIBLE_SCAN, scan(count));
    } else {
        let visible = u64::from(counts[COUNT_VISIBLE as usize]);
        set(ARGS_EXPAND, if count == 0 { 0 } else { groups(visible) });
    }
}

#[test]
fn sizes_and_overflow_are_planned() {
    let gpu = device::gpu();
    let mut check = Check::new("plan");
    let small = Params {
        group_limit: 7,
        isect_capacity: 5000,
        ..PARAMS
    };
    for variant in supported!(plan, gpu) {
        let choice = Choice {
            variant,
            ..Choice::default()
        };
        let kernel = Plan::new(&gpu, choice).unwrap();
        for params in [PARAMS, small] {
            for stage in [0, 1] {
                for count in [
                    0, 1, 63, 64, 65, 1023, 1024, 1025, 5000, 5001, 1_000_000, 1_000_001,
                ] {
                    for earlier in [0, 1] {
                        let params = Params { stage, ..params };
                        let mut before = [3; 16];
                        before[COUNT_VISIBLE as usize] = count.min(900_000);
                        before[COUNT_ISECT as usize] = count;
                        before[COUNT_FAILED as usize] = earlier;
                        let counted = buffer(&gpu, &before);
                        let untouched = DispatchArgs { x: 9, y: 9, z: 9 };
                        let mut args = [untouched; 8];
                        let planned = buffer(&gpu, &args);
                        let io = Bindings {
                            counts: &counted,
                            args: &planned,
                        };
                        gpu.run(|rec| kernel.record(rec, io, params)).unwrap();
                        expected(&mut before, &mut args, &params);
                        let case = format!("{count} in stage {stage}, failed {earlier}");
                        let counts = words(&read(&gpu, &counted));
                        let found = words(&read(&gpu, &planned));
                        check.outputs(
                            &case,
                            vec![
                                Output::exact("counts", counts, words(&before)),
                                Output::exact("args", found, words(&args)),
                            ],
                        );
                    }
                }
            }
        }
    }
    check.finish();
}
