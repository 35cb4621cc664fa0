//! Splats along rays: exact limits of linear projection, and its known failures.

use crate::common::scenes::{self, Scene};
use ashfall::reference::{Thresholds, ray, render};

/// Largest difference of a channel between linear projection and ray casting.
fn apart(scene: &Scene) -> f64 {
    let mut options = scene.options;
    options.thresholds = Thresholds::NONE;
    let linear = render(&scene.splats, &scene.camera, &options);
    let pixels: Vec<usize> = (0..linear.pixels.len()).collect();
    let rays = ray::colors(&scene.splats, &scene.camera, &options, &pixels);
    let difference = |(a, b): (&[f64; 3], &ashfall::reference::Pixel<f64>)| {
        (0..3).map(|c| (a[c] - b.color[c]).abs()).fold(0.0, f64::max)
    };
    rays.iter().zip(&linear.pixels).map(difference).fold(0.0, f64::max)
}

#[test]
fn linear_projection_is_the_limit_of_small_splats() {
    let scene = scenes::gentle(81, 30, 40, 30, 1);
    // The same picture from smaller splats and a longer focal length: σ / z falls, pixels stay.
    let narrowed = |factor: f32| {
        let mut narrow = scene.clone();
        let axis = |splat: &mut [f32; 3]| splat.iter_mut().for_each(|s| *s += factor.ln());
        narrow.splats.log_scale.iter_mut().for_each(axis);
        narrow.camera.focal /= f64::from(factor);
        // Towards the optical axis by the same factor, at unchanged depth.
        let forward = narrow.camera.rotation.row(2);
        for mean in &mut narrow.splats.mean {
            let from_camera = glam::DVec3::from(mean.map(f64::from)) - narrow.camera.position;
            let along = forward * forward.dot(from_camera);
            let place = along + (from_camera - along) * f64::from(factor);
            *mean = (narrow.camera.position + place).to_array().map(|x| x as f32);
        }
        apart(&narrow)
    };
    let errors = [1.0, 0.25, 1.0 / 16.0].map(narrowed);
    println!("linear projection is off by {errors:?}");
    assert!(errors[0] > 1e-3, "{errors:?}");
    // First order in σ / z.
    assert!(errors[1] < 0.4 * errors[0] && errors[2] < 0.4 * errors[1], "{errors:?}");
}

#[test]
fn what_lies_behind_the_camera_has_no_lobe_before_it() {
    let mut scene = scenes::gentle(82, 1, 20, 20, 0);
    let back = scene.camera.rotation.row(2);
    scene.splats.mean[0] = (scene.camera.position - back).to_array().map(|x| x as f32);
    scene.options.near = -10.0;
    scene.splats.log_scale[0] = [0.5; 3];
    let pixels: Vec<usize> = (0..400).collect();
    let background = scene.options.background;
    for color in ray::colors(&scene.splats, &scene.camera, &scene.options, &pixels) {
        assert_eq!(color, background);
    }
}
