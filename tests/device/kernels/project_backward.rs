//! Gradient of every parameter from sums over pixels.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::{self, Scene};
use ashfall::gpu::Gpu;
use ashfall::kernels::Kernel;
use ashfall::kernels::project_backward::{Choice, ProjectBackward};
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::project_backward::{GradientOutputs, SplatSums, commands, project_backward};
use ashfall::layout::COUNT_FAILED;
use ashfall::scene::ScreenFilter;

fn mip(mut scene: Scene) -> Scene {
    scene.splats.filter = ScreenFilter::Mip;
    scene
}

/// Scenes of a degree, with and without 3D filters.
fn sums(degree: u32) -> Vec<(&'static str, SplatSums)> {
    let plain = [
        ("nothing to do", scenes::gentle(30, 0, 33, 47, degree)),
        ("one", scenes::gentle(31, 1, 33, 47, degree)),
        ("2^6 + 1", scenes::gentle(32, 65, 80, 61, degree)),
        ("hard", scenes::hard(33, 270, 97, 129, degree)),
        ("mip", mip(scenes::gentle(34, 100, 97, 129, degree))),
        ("mip, hard", mip(scenes::hard(35, 270, 97, 129, degree))),
    ];
    let smoothed = [
        ("smoothed", mip(scenes::gentle(37, 100, 97, 129, degree))),
        ("smoothed, hard", mip(scenes::hard(38, 270, 97, 129, degree))),
    ];
    let filtered = |(name, scene): (_, Scene)| (name, SplatSums::new(&scene, &scenes::filters(&scene.splats, 2)));
    let plain = plain
        .into_iter()
        .map(|(name, scene)| (name, SplatSums::new(&scene, &[])));
    plain.chain(smoothed.into_iter().map(filtered)).collect()
}

#[test]
fn sums_become_gradients_of_parameters() {
    let gpu = device::gpu();
    let mut check = Check::new("project_backward");
    for degree in 0..=3 {
        let case = |(name, sums)| (name, project_backward(&gpu, sums).unwrap());
        let cases: Vec<_> = sums(degree).into_iter().map(case).collect();
        check.cases(&gpu, Workgroups::subgroups(&[8, 64]), &cases);
    }
    check.finish();
}

/// Gradients and statistics, of slots in the order of an index where there is one.
fn run(gpu: &Gpu, sums: &SplatSums, index: Option<&[u32]>, failed: u32) -> [Vec<[f32; 4]>; 2] {
    let outputs = GradientOutputs::new(gpu, &sums.scene).unwrap();
    let case = commands(gpu, sums, index, &[(COUNT_FAILED, failed)], &outputs).unwrap();
    let choice = case.tuned(Choice::default());
    let kernel = ProjectBackward::compile(gpu, choice).unwrap();
    case.run(gpu, &kernel, &choice).unwrap();
    outputs.read(gpu).unwrap()
}

#[test]
fn a_failed_frame_has_no_gradients() {
    let gpu = device::gpu();
    for (name, sums) in sums(1) {
        let [gradients, _] = run(&gpu, &sums, None, 1);
        let untouched = gradients.iter().flatten().all(|x| x.is_nan());
        assert!(untouched, "{name}: wrote, though failed");
    }
}

#[test]
fn slots_may_lie_in_any_order() {
    let gpu = device::gpu();
    let sums = SplatSums::new(&scenes::hard(33, 270, 97, 129, 3), &[]);
    let index = scenes::shuffled(270);
    let [ordered, statistics] = run(&gpu, &sums, None, 0);
    let [moved, moved_statistics] = run(&gpu, &sums, Some(&index), 0);
    let expected = scenes::in_order(&ordered, &index);
    assert!(moved == expected, "not in their places");
    assert!(ordered != expected, "the order makes no difference");
    assert_eq!(moved_statistics, statistics);
}

#[test]
fn a_splat_may_have_more_records_than_a_driver_runs_loops() {
    let gpu = device::gpu();
    let mut sums = SplatSums::new(&scenes::gentle(36, 1, 33, 47, 3), &[]);
    let records = 80_001;
    sums.tiles = vec![records as u32];
    sums.begins = vec![0];
    sums.records = vec![[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]; records];
    let [found, _] = run(&gpu, &sums, None, 0);
    // The constant harmonic's blue: the third number of the fourth plane. Sums of ones are exact.
    let expected = records as f64 * 0.28209479177387814;
    let blue = f64::from(found[3][2]);
    assert!((blue / expected - 1.0).abs() < 1e-6, "{blue}, not {expected}");
}
