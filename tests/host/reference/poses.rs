//! The gradient by the camera's pose: the limit of differences, and what it must be under motions of the world.

use crate::common::scenes::{self, Scene};
use crate::reference::{assert_close, central_difference};
use ashfall::reference::gradient::backward;
use ashfall::reference::loss::{self, Target};
use ashfall::reference::pose_gradient::pose_gradient;
use ashfall::reference::rasterize_backward::PixelGradient;
use ashfall::reference::{Splat, Thresholds, Viewpoint, render};
use ashfall::scene::{Camera, ScreenFilter};
use glam::{DMat3, DQuat, DVec3};

/// Gradient of a scene's loss by its pose.
fn gradient(scene: &Scene, target: &Target<'_>) -> [[f64; 3]; 2] {
    let image = render(&scene.splats, &scene.camera, &scene.options).colors();
    let upstream = |color| PixelGradient {
        color,
        ..PixelGradient::default()
    };
    let upstream: Vec<PixelGradient> = loss::gradient(&image, target).into_iter().map(upstream).collect();
    let (by_screen, _) = backward(&scene.splats, &scene.camera, &scene.options, &upstream);
    let rows: Vec<[f64; 10]> = by_screen.iter().map(|gradient| gradient.row).collect();
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let splats = Splat::<f64>::all(&scene.splats);
    pose_gradient(&splats, &vec![0.0; splats.len()], &view, &rows)
}

#[test]
fn the_pose_has_the_gradient_of_differences() {
    let mut mip = scenes::gentle(71, 8, 24, 19, 3);
    mip.splats.filter = ScreenFilter::Mip;
    for mut scene in [scenes::gentle(70, 8, 24, 19, 2), mip] {
        scene.options.thresholds = Thresholds::NONE;
        let photo = scenes::photo_values(&scenes::photo(4, 24, 19));
        let target = Target::new(24, &photo);
        let loss_at = |camera: &Camera| {
            let image = render(&scene.splats, camera, &scene.options).colors();
            loss::loss(&image, &target)
        };
        let [position, turn] = gradient(&scene, &target);
        let largest = |of: [f64; 3]| of.iter().fold(0.0, |most: f64, d| most.max(d.abs()));
        assert!(
            largest(position) > 1e-3 && largest(turn) > 1e-3,
            "a gradient worth comparing"
        );
        for axis in 0..3 {
            let unit = DVec3::from(std::array::from_fn(|i| f64::from(u8::from(i == axis))));
            let shifted = |x: f64| {
                loss_at(&Camera {
                    position: scene.camera.position + x * unit,
                    ..scene.camera
                })
            };
            let turned = |x: f64| {
                let turn = DMat3::from_quat(DQuat::from_scaled_axis(x * unit));
                loss_at(&Camera {
                    rotation: scene.camera.rotation * turn,
                    ..scene.camera
                })
            };
            let slope = central_difference(shifted, 0.0, 2e-5);
            assert_close(position[axis], slope, 1e-6, largest(position));
            let slope = central_difference(turned, 0.0, 2e-5);
            assert_close(turn[axis], slope, 1e-6, largest(turn));
        }
    }
}

#[test]
fn to_move_the_camera_is_to_move_all_splats_the_other_way() {
    let scene = scenes::hard(72, 40, 33, 26, 3);
    let photo = scenes::photo_values(&scenes::photo(5, 33, 26));
    let target = Target::new(33, &photo);
    let [position, _] = gradient(&scene, &target);
    let splats = ashfall::reference::loss_gradient(&scene.splats, &scene.camera, &scene.options, &target);
    for axis in 0..3 {
        let force: f64 = splats.d_splats.mean.iter().map(|d| d[axis]).sum();
        let scale: f64 = splats.d_splats.mean.iter().map(|d| d[axis].abs()).sum();
        assert_close(position[axis], -force, 1e-10, scale);
    }
}
