//! Dispatch sizes and overflow, against a model in wide integers.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use ashfall::gpu::Groups;
use ashfall::kernels::plan::{Bindings, Choice, Params, Plan};
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::plan::{PARAMS, plan};
use ashfall::layout::*;

/// Where the splats of a list begin among the intersections.
fn offsets(tiles: &[u32]) -> Vec<u32> {
    let mut sum = 0;
    tiles
        .iter()
        .map(|count| {
            sum += count;
            sum - count
        })
        .collect()
}

/// Expected bands: the splats and the intersections of each, taken as they come.
fn cut(tiles: &[u32], params: &Params) -> Vec<(u32, u32)> {
    let mut bands = vec![(0, 0)];
    for &count in tiles {
        let mut band = bands.pop().unwrap_or_default();
        if band.1 + count > params.isect_capacity || band.0 == params.rank_limit {
            bands.push(band);
            band = (0, 0);
        }
        bands.push((band.0 + 1, band.1 + count));
    }
    bands
}

#[test]
fn bands_hold_as_many_splats_as_fit() {
    let gpu = device::gpu();
    let mut check = Check::new("plan, bands");
    let kernel = Plan::new(&gpu, Choice::default()).unwrap();
    let random = &mut Random::new(5);
    for (splats, isect_capacity, rank_limit) in [
        (0, 100, u32::MAX),
        (1, 100, u32::MAX),
        (700, 100, u32::MAX),
        (700, 64, u32::MAX),
        (700, 1_000_000, 33),
        (700, 300, 17),
        (5000, 4_000, 999),
        (300, 1_000_000, u32::MAX),
        (300, 1_000_000, 300),
    ] {
        let tiles: Vec<u32> = (0..splats).map(|_| 1 + random.below(64) as u32).collect();
        let offsets = offsets(&tiles);
        let params = Params {
            stage: 1,
            isect_capacity,
            rank_limit,
            ..PARAMS
        };
        let bands = cut(&tiles, &params);
        // As many bands as are needed, two more, and one too few.
        for recorded in [bands.len(), bands.len() + 2, bands.len() - 1] {
            let mut before = [0; COUNT_SLOTS as usize];
            before[COUNT_VISIBLE as usize] = splats as u32;
            before[COUNT_ISECT as usize] = tiles.iter().sum();
            let counted = buffer(&gpu, &before);
            let untouched = DispatchArgs { x: 9, y: 9, z: 9 };
            let args = buffer(&gpu, &[untouched; ARGS_SLOTS as usize]);
            let io = Bindings {
                counts: &counted,
                args: &args,
                isect_from_rank: &buffer(&gpu, &offsets),
            };
            let slots = [COUNT_BAND_BEGIN, COUNT_BAND_END, COUNT_BAND_BASE, COUNT_ISECT];
            let (mut found, mut expected) = (Vec::new(), Vec::new());
            let run = |band, found: &mut Vec<u32>| {
                let params = Params {
                    band: band as u32,
                    band_count: recorded as u32,
                    ..params
                };
                gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(1))).unwrap();
                let counts = read(&gpu, &counted);
                found.extend(slots.map(|slot| counts[slot as usize]));
                found.push(read(&gpu, &args)[ARGS_TILE as usize].x);
            };
            (0..recorded).for_each(|band| run(band, &mut found));
            let failed = read(&gpu, &counted)[COUNT_FAILED as usize];
            let (mut rank, mut isect) = (0, 0);
            for band in 0..recorded {
                let (ranks, isects) = bands.get(band).copied().unwrap_or((0, 0));
                let drawn = if ranks > 0 { params.tile_count } else { 0 };
                expected.extend([rank, rank + ranks, isect, isects, drawn]);
                (rank, isect) = (rank + ranks, isect + isects);
            }
            let name = format!("{splats} splats, {recorded} bands of {}", bands.len());
            let too_few = recorded < bands.len();
            // With a single band that does not suffice, nothing is planned: see the other test.
            if !(too_few && recorded == 1) {
                check.outputs(&name, vec![Output::exact("bands", words(&found), words(&expected))]);
            }
            let failed_as = Output::exact("failed", words(&[failed]), words(&[u32::from(too_few)]));
            if recorded > 0 {
                check.outputs(&name, vec![failed_as]);
            }
        }
    }
    check.finish();
}

#[test]
fn more_intersections_than_can_be_counted_fail_the_frame() {
    let gpu = device::gpu();
    let kernel = Plan::new(&gpu, Choice::default()).unwrap();
    let mut before = [0; COUNT_SLOTS as usize];
    before[COUNT_VISIBLE as usize] = 3;
    before[COUNT_ISECT as usize] = u32::MAX;
    let counted = buffer(&gpu, &before);
    let io = Bindings {
        counts: &counted,
        args: &unwritten(&gpu, ARGS_SLOTS as usize),
        isect_from_rank: &buffer(&gpu, &[0, 1, 2]),
    };
    let params = Params {
        stage: 1,
        band_count: 8,
        ..PARAMS
    };
    gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(1))).unwrap();
    let after = read(&gpu, &counted);
    assert_eq!(after[COUNT_FAILED as usize], 1);
    assert_eq!(after[COUNT_ISECT as usize], 0);
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
    let counts = [0, 1, 63, 64, 65, 1023, 1024, 1025, 5000, 5001, 1_000_000, 1_000_001];
    for (params, stage, earlier) in [PARAMS, small]
        .into_iter()
        .flat_map(|params| [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(stage, failed)| (params, stage, failed)))
    {
        let params = Params { stage, ..params };
        let cases = counts.map(|count| {
            let mut before = [3; 16];
            before[COUNT_VISIBLE as usize] = count.min(900_000);
            before[COUNT_ISECT as usize] = count;
            before[COUNT_FAILED as usize] = earlier;
            // As many to each splat as to the next, more or less.
            let visible = u64::from(before[COUNT_VISIBLE as usize]);
            let offset = |rank| rank * u64::from(count) / visible;
            let offsets: Vec<u32> = (0..visible).map(|i| offset(i) as u32).collect();
            let name = format!("{count} in stage {stage}, failed {earlier}");
            (name, plan(&gpu, &params, &before, &offsets).unwrap())
        });
        check.cases(&gpu, Workgroups::FIXED, &cases);
    }
    check.finish();
}
