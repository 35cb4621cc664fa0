//! Force and torque about the camera, against the gradient by the camera's pose.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::{self, Scene};
use ashfall::gpu::Gpu;
use ashfall::kernels::Kernel;
use ashfall::kernels::pose_gradient::{Choice, PoseGradient};
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::pose_gradient::{SplatForces, commands, pose_gradient};
use ashfall::layout::COUNT_FAILED;
use ashfall::scene::ScreenFilter;

fn mip(mut scene: Scene) -> Scene {
    scene.splats.filter = ScreenFilter::Mip;
    scene
}

#[test]
fn forces_and_torques_are_the_gradient_of_the_pose() {
    let gpu = device::gpu();
    let mut check = Check::new("pose_gradient");
    for degree in 0..=3 {
        let plain = |scene: Scene| SplatForces::new(&scene, &[]);
        let smoothed = mip(scenes::gentle(37, 100, 97, 129, degree));
        let filters = scenes::filters(&smoothed.splats, 2);
        let cases = [
            ("one", plain(scenes::gentle(31, 1, 33, 47, degree))),
            ("2^6 + 1", plain(scenes::gentle(32, 65, 80, 61, degree))),
            ("two workgroups", plain(scenes::gentle(36, 1_025, 80, 61, degree))),
            ("hard", plain(scenes::hard(33, 270, 97, 129, degree))),
            ("mip", plain(mip(scenes::gentle(34, 100, 97, 129, degree)))),
            ("smoothed", SplatForces::new(&smoothed, &filters)),
        ]
        .map(|(name, forces)| (name, pose_gradient(&gpu, forces).unwrap()));
        check.cases(&gpu, Workgroups::any(&[8, 64, 256]), &cases);
    }
    check.finish();
}

fn sums(gpu: &Gpu, forces: &SplatForces, failed: u32) -> Vec<[f32; 4]> {
    let partials = gpu.buffer::<[f32; 4]>("sums_from_group", 2).unwrap();
    let case = commands(gpu, forces, &[(COUNT_FAILED, failed)], &partials).unwrap();
    let case = case.erase(&partials);
    let choice = case.tuned(Choice::default());
    let kernel = PoseGradient::compile(gpu, choice).unwrap();
    case.run(gpu, &kernel, &choice).unwrap();
    read(gpu, &partials)
}

#[test]
fn a_failed_frame_has_no_sums_and_poison_stays_out() {
    let gpu = device::gpu();
    let forces = |poison: Option<f32>| {
        let mut forces = SplatForces::new(&scenes::gentle(39, 3, 64, 48, 2), &[]);
        forces.planes[1] = [0.0; 4];
        forces.planes[4] = [0.0; 4];
        if let Some(poison) = poison {
            forces.planes[1][2] = poison;
        }
        forces
    };
    assert!(sums(&gpu, &forces(None), 1).as_flattened().iter().all(|x| x.is_nan()));
    let without = sums(&gpu, &forces(None), 0);
    assert!(without[0][0] != 0.0 && without[1][1] != 0.0);
    for poison in [f32::NAN, f32::INFINITY] {
        assert_eq!(sums(&gpu, &forces(Some(poison)), 0), without);
    }
}
