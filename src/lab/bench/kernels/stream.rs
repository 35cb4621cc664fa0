//! Kernels that read, write and hardly compute: compaction, gathering, ranges, dispatch sizes.

use super::{ELEMENTWISE, args, counts, read, sizes, wanted};
use crate::Result;
use crate::gpu::Groups;
use crate::kernels::{compact, gather, plan, ranges};
use crate::lab::bench::check::{Output, words};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::{Bench, Unit, Work};
use crate::layout::*;
use crate::reference;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for &count in sizes(bench.gpu().caps()) {
        compact(bench, count)?;
        gather(bench, count)?;
        ranges(bench, count)?;
    }
    plan(bench)
}

/// Three splats of four are visible.
fn compact(bench: &mut Bench, count: usize) -> Result<()> {
    let gpu = bench.gpu().clone();
    let random = &mut Random::new(count as u64);
    let tiles: Vec<u32> = (0..count).map(|_| random.below(4) as u32).collect();
    let visible = tiles.iter().filter(|&&tiles| tiles > 0).count();
    // A flag and a place for all; a depth, and a pair to write, for the visible.
    let work = Work::of(count, Unit::Splats).moving(8 * count + 12 * visible);
    let choices = wanted!(bench, compact, count, ELEMENTWISE, work);
    if choices.is_empty() {
        return Ok(());
    }
    let depths: Vec<f32> = (0..count)
        .map(|_| random.between(0.1, 99.0) as f32)
        .collect();
    let rests: Vec<[f32; 2]> = depths.iter().map(|&depth| [0.0, depth]).collect();
    let flags: Vec<u32> = tiles.iter().map(|&tiles| tiles.min(1)).collect();
    let (places, _) = reference::scan::scan(&flags);
    let listed = |i: &usize| tiles[*i] > 0;
    let splats: Vec<f64> = (0..count).filter(listed).map(|i| i as f64).collect();
    let keys: Vec<f64> = (0..count)
        .filter(listed)
        .map(|i| f64::from(depths[i].to_bits()))
        .collect();
    let counts = counts(&gpu, &[(COUNT_SPLAT, count as u32)])?;
    let [tiles, places] = [
        gpu.buffer_from("tiles", &tiles)?,
        gpu.buffer_from("places", &places)?,
    ];
    let rests = gpu.buffer_from("rests", &rests)?;
    let [depth, splat] = [
        gpu.buffer("depths", visible)?,
        gpu.buffer("splats", visible)?,
    ];
    for (variant, workgroup, case) in choices {
        let spec = compact::Spec { workgroup };
        let kernel = compact::Compact::new(&gpu, compact::Choice { variant, spec })?;
        let io = compact::Bindings {
            counts: &counts,
            tile_count_from_splat: &tiles,
            visible_from_splat: &places,
            blue_depth_from_splat: &rests,
            depth_from_visible: &depth,
            splat_from_visible: &splat,
        };
        bench.trial(
            &case,
            |rec| {
                rec.fill(&depth, u32::MAX);
                rec.fill(&splat, u32::MAX);
            },
            |rec| kernel.record(rec, io, kernel.groups(count)),
            || {
                Ok(vec![
                    Output::exact("depths", words(&read(&gpu, &depth)?), keys.clone()),
                    Output::exact("splats", words(&read(&gpu, &splat)?), splats.clone()),
                ])
            },
        )?;
    }
    Ok(())
}

/// Through a random permutation, as the order of depths is one.
fn gather(bench: &mut Bench, count: usize) -> Result<()> {
    let gpu = bench.gpu().clone();
    let work = Work::of(count, Unit::Splats).moving(12 * count);
    let choices = wanted!(bench, gather, count, ELEMENTWISE, work);
    if choices.is_empty() {
        return Ok(());
    }
    let random = &mut Random::new(count as u64);
    let source: Vec<u32> = (0..count).map(|_| random.below(1000) as u32).collect();
    let index: Vec<u32> = random
        .permutation(count)
        .iter()
        .map(|&i| i as u32)
        .collect();
    let expected: Vec<f64> = index
        .iter()
        .map(|&i| f64::from(source[i as usize]))
        .collect();
    let counts = counts(&gpu, &[(COUNT_VISIBLE, count as u32)])?;
    let [source, index] = [
        gpu.buffer_from("source", &source)?,
        gpu.buffer_from("index", &index)?,
    ];
    let target = gpu.buffer("target", count)?;
    for (variant, workgroup, case) in choices {
        let spec = gather::Spec { workgroup };
        let kernel = gather::Gather::new(&gpu, gather::Choice { variant, spec })?;
        let args = args(&gpu, count, workgroup)?;
        let io = gather::Bindings {
            counts: &counts,
            splat_from_rank: &index,
            tile_count_from_splat: &source,
            tile_count_from_rank: &target,
        };
        bench.trial(
            &case,
            |rec| rec.fill(&target, u32::MAX),
            |rec| kernel.record(rec, io, Groups::indirect(&args, 0)),
            || {
                let found = words(&read(&gpu, &target)?);
                Ok(vec![Output::exact("values", found, expected.clone())])
            },
        )?;
    }
    Ok(())
}

/// About a hundred intersections a tile.
fn ranges(bench: &mut Bench, count: usize) -> Result<()> {
    let gpu = bench.gpu().clone();
    let tile_count = count / 100;
    // A tile for every intersection, its neighbour's being at hand; a slice for every tile.
    let work = Work::of(count, Unit::Isects).moving(4 * count + 8 * tile_count);
    let choices = wanted!(bench, ranges, count, ELEMENTWISE, work);
    if choices.is_empty() {
        return Ok(());
    }
    let random = &mut Random::new(count as u64);
    let mut tiles: Vec<u32> = (0..count)
        .map(|_| random.below(tile_count) as u32)
        .collect();
    tiles.sort_unstable();
    // An empty slice may lie anywhere; the kernel leaves it at 0.
    let expected: Vec<[u32; 2]> = reference::ranges::ranges(&tiles, tile_count as u32)
        .into_iter()
        .map(|[begin, end]| if begin == end { [0, 0] } else { [begin, end] })
        .collect();
    let counts = counts(&gpu, &[(COUNT_ISECT, count as u32)])?;
    let tiles = gpu.buffer_from("tiles", &tiles)?;
    let slices = gpu.buffer::<[u32; 2]>("ranges", tile_count)?;
    let params = ranges::Params {
        tile_count: tile_count as u32,
        list_limit: u32::MAX,
    };
    for (variant, workgroup, case) in choices {
        let spec = ranges::Spec { workgroup };
        let kernel = ranges::Ranges::new(&gpu, ranges::Choice { variant, spec })?;
        let args = args(&gpu, count, workgroup)?;
        let io = ranges::Bindings {
            counts: &counts,
            tile_from_isect: &tiles,
            range_from_tile: &slices,
        };
        bench.trial(
            &case,
            |rec| rec.fill(&slices, 0),
            |rec| kernel.record(rec, io, params, Groups::indirect(&args, 0)),
            || {
                let found = words(&read(&gpu, &slices)?);
                Ok(vec![Output::exact("ranges", found, words(&expected))])
            },
        )?;
    }
    Ok(())
}

/// One invocation: what a frame pays for its sizes being known only to the device.
fn plan(bench: &mut Bench) -> Result<()> {
    let gpu = bench.gpu().clone();
    let visible = 123_457u32;
    let params = plan::Params {
        stage: 0,
        isect_capacity: 1 << 20,
        chunk: 1024,
        chunks_per_group: 8,
        digit_count: 256,
        workgroup: 64,
        group_limit: 65_535,
        tile_count: 0,
        band: 0,
        band_count: 1,
        rank_limit: u32::MAX,
    };
    let begins = counts(&gpu, &[])?;
    let before = counts(&gpu, &[(COUNT_VISIBLE, visible)])?;
    let after = counts(&gpu, &[])?;
    let planned = gpu.buffer_from("args", &[DispatchArgs::default(); ARGS_SLOTS as usize])?;
    for (variant, _, case) in wanted!(bench, plan, "visible", [0], Work::default()) {
        let choice = plan::Choice {
            variant,
            ..plan::Choice::default()
        };
        let kernel = plan::Plan::new(&gpu, choice)?;
        let io = plan::Bindings {
            counts: &after,
            args: &planned,
            isect_from_rank: &begins,
        };
        let twice = 2 * params.chunks_per_group;
        let chunks = twice * (visible / (twice * params.chunk));
        let table = chunks * params.digit_count;
        let scan = |values: u32| values.div_ceil(SCAN_CHUNK).div_ceil(params.workgroup);
        let expected = [
            (ARGS_VISIBLE, visible.div_ceil(params.workgroup)),
            (ARGS_VISIBLE_CHUNK, chunks.div_ceil(params.chunks_per_group)),
            (ARGS_VISIBLE_TABLE, scan(table)),
            (ARGS_VISIBLE_SCAN, scan(visible)),
        ];
        bench.trial(
            &case,
            |rec| rec.copy(&before, 0..before.len(), &after, 0),
            |rec| kernel.record(rec, io, params, Groups::Count(1)),
            || {
                let (found, slots) = (read(&gpu, &planned)?, read(&gpu, &after)?);
                let groups = expected.map(|(slot, _)| f64::from(found[slot as usize].x));
                let counted = [COUNT_VISIBLE_CHUNK, COUNT_VISIBLE_TABLE];
                let counted = counted.map(|slot| f64::from(slots[slot as usize]));
                let wanted = expected.map(|(_, groups)| f64::from(groups));
                let sums = [chunks, table].map(f64::from);
                Ok(vec![
                    Output::exact("groups", groups.into(), wanted.into()),
                    Output::exact("counts", counted.into(), sums.into()),
                ])
            },
        )?;
    }
    Ok(())
}
