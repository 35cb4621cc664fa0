//! Whole frames against the oracle's.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a test that cannot go on may say so by panicking"
)]

#[path = "common/device.rs"]
mod device;
#[path = "common/scenes.rs"]
mod scenes;

use ashfall::reference;
use ashfall::render::{Accuracy, Model, RenderOptions, Renderer, ViewOptions};
use ashfall::scene::RenderMode;
use scenes::Scene;

/// The largest error over the pixels far from any discontinuity, the share of pixels near one, and the
/// largest error over those.
fn compare(scene: &Scene) -> (f64, f64, f64) {
    let gpu = device::gpu();
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let cuts = &scene.options.cuts;
    let options = RenderOptions {
        with_depth: true,
        accuracy: Accuracy {
            transmittance_min: cuts.transmittance_min as f32,
            alpha_min: cuts.alpha_min as f32,
            sigma_max: None,
        },
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    let view = ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        mode: scene.splats.mode,
    };
    let image = renderer.render(&model, &scene.camera, &view).unwrap();
    let expected = reference::frame::render(&scene.splats, &scene.camera, &scene.options);
    let bands = reference::frame::bands(&scene.splats, &scene.camera, &scene.options);
    let (mut interior, mut near, mut flipped) = (0.0f64, 0usize, 0.0f64);
    for (i, (pixel, band)) in expected.pixels.iter().zip(&bands).enumerate() {
        let error = (0..3)
            .map(|c| (f64::from(image.rgb[i][c]) - pixel.color[c]).abs())
            .fold(0.0, f64::max);
        let error = error.max((f64::from(image.transmittance[i]) - pixel.transmittance).abs());
        assert!(error.is_finite(), "pixel {i} is not finite");
        if band.nearest() > 1e-4 {
            interior = interior.max(error);
        } else {
            near += 1;
            flipped = flipped.max(error);
        }
    }
    (interior, near as f64 / bands.len() as f64, flipped)
}

#[test]
fn gentle_frames_agree_with_the_oracle() {
    for (seed, count, width, height, degree) in [
        (1, 40, 64, 48, 3),
        (2, 120, 97, 65, 2),
        (3, 10, 17, 33, 0),
        (4, 300, 130, 90, 1),
    ] {
        let (interior, near, flipped) =
            compare(&scenes::gentle(seed, count, width, height, degree));
        println!("seed {seed}: interior {interior:.2e}, near {near:.4}, there {flipped:.2e}");
        assert!(interior <= 1e-4, "seed {seed}: {interior}");
        assert!(
            near < 0.2 && flipped <= 2.0 / 255.0,
            "seed {seed}: {near} of the pixels, {flipped}"
        );
    }
}

#[test]
fn hard_frames_agree_with_the_oracle() {
    for (seed, count) in [(11, 60), (12, 150)] {
        let (interior, near, flipped) = compare(&scenes::hard(seed, count, 80, 61, 3));
        println!("seed {seed}: interior {interior:.2e}, near {near:.4}, there {flipped:.2e}");
        assert!(interior <= 1e-3, "seed {seed}: {interior}");
    }
}

#[test]
fn mip_frames_agree_with_the_oracle() {
    for (seed, count) in [(21, 60), (22, 150)] {
        for make in [scenes::gentle, scenes::hard] {
            let mut scene = make(seed, count, 80, 61, 1);
            scene.splats.mode = RenderMode::Mip;
            let (interior, near, flipped) = compare(&scene);
            println!("seed {seed}: interior {interior:.2e}, near {near:.4}, there {flipped:.2e}");
            assert!(interior <= 1e-4, "seed {seed}: {interior}");
            assert!(
                near < 0.2 && flipped <= 2.0 / 255.0,
                "seed {seed}: {near} of the pixels, {flipped}"
            );
        }
    }
}

#[test]
fn frames_cut_as_they_are_told_to() {
    for (alpha_min, transmittance_min) in
        [(1.0 / 1024.0_f64, 1e-6), (1.0 / 64.0, 1e-2), (0.125, 0.25)]
    {
        for make in [scenes::gentle, scenes::hard] {
            let mut scene = make(31, 150, 80, 61, 1);
            // As the device holds them.
            scene.options.cuts.alpha_min = f64::from(alpha_min as f32);
            scene.options.cuts.transmittance_min = f64::from(transmittance_min as f32);
            let (interior, near, flipped) = compare(&scene);
            println!("{alpha_min}: interior {interior:.2e}, near {near:.4}, there {flipped:.2e}");
            assert!(interior <= 1e-4, "{alpha_min}: {interior}");
            let jump = 2.0 * alpha_min.max(transmittance_min);
            assert!(
                near < 0.2 && flipped <= jump,
                "{alpha_min}: {near} of the pixels, {flipped}"
            );
        }
    }
}
