//! Exploration noise: random numbers and covariance.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::{self, POISON, Scene};
use crate::kernels::ELEMENTWISE;
use ashfall::gpu::Gpu;
use ashfall::kernels::perturb::{Bindings, Choice, Params, Perturb};
use ashfall::lab::bench::kernels::perturb::{PARAMS, faint, perturb};
use ashfall::layout::COUNT_FAILED;
use ashfall::render::{plane_count, planes_from_splats};
use ashfall::scene::ScreenFilter;

fn splats(count: usize) -> Scene {
    faint(scenes::gentle(count as u64, count, 64, 64, 0))
}

#[test]
fn means_move_by_noise_of_their_splats_shape() {
    let gpu = device::gpu();
    let mut check = Check::new("perturb");
    let cases = [
        ("nothing to move", 0),
        ("one", 1),
        ("2^6 + 1", 65),
        ("crosses workgroups", 3000),
    ]
    .map(|(name, count)| (name, perturb(&gpu, &splats(count)).unwrap()));
    check.cases(&gpu, ELEMENTWISE, &cases);
    let surfels = scenes::flattened(splats(300), ScreenFilter::Classic);
    let case = ("surfels", perturb(&gpu, &surfels).unwrap());
    check.cases(&gpu, ELEMENTWISE, &[case]);
    check.finish();
}

/// Planes after the noise, their slots in the order of an index where there is one.
fn run(gpu: &Gpu, planes: &[[f32; 4]], index: Option<&[u32]>, failed: u32) -> Vec<[f32; 4]> {
    let kernel = Perturb::new(gpu, Choice::default()).unwrap();
    let (values, count) = (buffer(gpu, planes), planes.len() / plane_count(0));
    let io = Bindings {
        counts: &counts(gpu, &[(COUNT_FAILED, failed)]),
        params: &values,
        splat_from_slot: &buffer(gpu, index.unwrap_or(&[u32::MAX])),
    };
    let params = Params {
        first_splat: 0,
        splat_count: count as u32,
        stride: count as u32,
        indexed: index.is_some().into(),
        ..PARAMS
    };
    gpu.run(|rec| kernel.record(rec, io, params, kernel.groups(count)))
        .unwrap();
    read(gpu, &values)
}

#[test]
fn a_failed_frame_moves_nothing() {
    let gpu = device::gpu();
    let planes = planes_from_splats(&splats(30).splats);
    assert_eq!(run(&gpu, &planes, None, 1), planes);
}

#[test]
fn poison_stays_with_its_splat() {
    let gpu = device::gpu();
    let clean = planes_from_splats(&splats(3000).splats);
    let (count, mut poisoned) = (3000, clean.clone());
    for (i, poison) in POISON.iter().enumerate() {
        poisoned[(i % 3) * count + 50 * i][i % 4] = *poison;
    }
    let (expected, found) = (run(&gpu, &clean, None, 0), run(&gpu, &poisoned, None, 0));
    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let splat = i % count;
        if splat % 50 != 0 || splat / 50 >= POISON.len() {
            assert_eq!(found, expected, "beside poison");
        } else if i < count {
            let is_finite = poisoned[i].iter().all(|x| x.is_finite());
            assert!(!is_finite || found.iter().all(|x| x.is_finite()), "splat {i} is moved");
        }
    }
}

#[test]
fn slots_may_lie_in_any_order() {
    let gpu = device::gpu();
    let planes = planes_from_splats(&splats(270).splats);
    let index = scenes::shuffled(270);
    let ordered = scenes::in_order(&run(&gpu, &planes, None, 0), &index);
    let moved = scenes::in_order(&planes, &index);
    assert_eq!(run(&gpu, &moved, Some(&index), 0), ordered);
    assert_ne!(run(&gpu, &moved, None, 0), ordered, "the order makes no difference");
}
