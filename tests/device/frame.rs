//! Whole frames against the oracle.

use crate::common::scenes::Scene;
use ashfall::gpu::Buffer;
use ashfall::reference;
use ashfall::render::{Accuracy, Model, Precision, RenderOptions, RenderedImage, Renderer, ViewOptions};
use ashfall::scene::{ScreenFilter, Splats};

/// Largest error over the pixels far from any discontinuity, share of pixels near one, and largest error over those.
fn compare(scene: &Scene) -> (f64, f64, f64) {
    let gpu = crate::common::device::gpu();
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let thresholds = &scene.options.thresholds;
    let options = RenderOptions {
        with_depth: true,
        accuracy: Accuracy {
            transmittance_min: thresholds.transmittance_min as f32,
            alpha_min: thresholds.alpha_min as f32,
        },
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    let view = ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        filter: scene.splats.filter,
    };
    let image = renderer.render(&model, &scene.camera, &view).unwrap();
    let expected = reference::frame::render(&scene.splats, &scene.camera, &scene.options);
    let margins = reference::frame::discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
    let (mut interior, mut near, mut flipped) = (0.0f64, 0usize, 0.0f64);
    for (i, (pixel, margin)) in expected.pixels.iter().zip(&margins).enumerate() {
        let error = (0..3)
            .map(|c| (f64::from(image.rgb[i][c]) - pixel.color[c]).abs())
            .fold(0.0, f64::max);
        let error = error.max((f64::from(image.transmittance[i]) - pixel.transmittance).abs());
        assert!(error.is_finite(), "pixel {i} is not finite");
        if margin.nearest() > 1e-4 {
            interior = interior.max(error);
        } else {
            near += 1;
            flipped = flipped.max(error);
        }
    }
    (interior, near as f64 / margins.len() as f64, flipped)
}

#[test]
fn gentle_frames_agree_with_the_oracle() {
    for (seed, count, width, height, degree) in [
        (1, 40, 64, 48, 3),
        (2, 120, 97, 65, 2),
        (3, 10, 17, 33, 0),
        (4, 300, 130, 90, 1),
    ] {
        let (interior, near, flipped) = compare(&crate::common::scenes::gentle(seed, count, width, height, degree));
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
        let (interior, near, flipped) = compare(&crate::common::scenes::hard(seed, count, 80, 61, 3));
        println!("seed {seed}: interior {interior:.2e}, near {near:.4}, there {flipped:.2e}");
        assert!(interior <= 1e-3, "seed {seed}: {interior}");
    }
}

#[test]
fn mip_frames_agree_with_the_oracle() {
    for (seed, count) in [(21, 60), (22, 150)] {
        for make in [crate::common::scenes::gentle, crate::common::scenes::hard] {
            let mut scene = make(seed, count, 80, 61, 1);
            scene.splats.filter = ScreenFilter::Mip;
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
    for (alpha_min, transmittance_min) in [(1.0 / 1024.0_f64, 1e-6), (1.0 / 64.0, 1e-2), (0.125, 0.25)] {
        for make in [crate::common::scenes::gentle, crate::common::scenes::hard] {
            let mut scene = make(31, 150, 80, 61, 1);
            // Rounded to f32, as on the device.
            scene.options.thresholds.alpha_min = f64::from(alpha_min as f32);
            scene.options.thresholds.transmittance_min = f64::from(transmittance_min as f32);
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

fn draw_as(scene: &Scene, precision: Precision) -> RenderedImage {
    let gpu = crate::common::device::gpu();
    let model = Model::upload_as(&gpu, &scene.splats, precision).unwrap();
    let options = RenderOptions {
        precision,
        ..RenderOptions::default()
    };
    let view = ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        filter: scene.splats.filter,
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    renderer.render(&model, &scene.camera, &view).unwrap()
}

#[test]
fn a_scene_stored_as_halves_is_drawn_as_the_rounded_one() {
    let largest = |a: &RenderedImage, b: &RenderedImage| {
        let all = a.rgb.as_flattened().iter().zip(b.rgb.as_flattened());
        all.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    for (seed, degree) in [(21, 3), (22, 2), (23, 1), (24, 0)] {
        let scene = crate::common::scenes::gentle(seed, 60, 65, 49, degree);
        let full = draw_as(&scene, Precision::Full);
        for precision in [Precision::HalfHarmonics, Precision::Half] {
            let found = draw_as(&scene, precision);
            let mut rounded = scene.clone();
            rounded.splats = precision.rounded(&scene.splats);
            let wanted = draw_as(&rounded, Precision::Full);
            // The same formulas on the same numbers; a compiler may reorder a sum.
            let (off, moved) = (largest(&found, &wanted), largest(&found, &full));
            println!("degree {degree}, {precision:?}: {off:.1e}, from whole numbers {moved:.1e}");
            assert!(off <= 1e-5, "degree {degree}, {precision:?}: {off:e}");
            assert!(moved > 10.0 * off, "rounding shows nowhere: {moved:e}");
        }
    }
}

/// Splats of different SH degrees are stored in separate blocks and drawn as if all had the highest: at equal depths
/// the lower index is in front, too.
#[test]
fn frames_of_several_degrees_are_those_of_the_highest() {
    let gpu = crate::common::device::gpu();
    for precision in [Precision::Full, Precision::HalfHarmonics, Precision::Half] {
        let mut scene = crate::common::scenes::gentle(40, 9_000, 130, 90, 3);
        let splats = &mut scene.splats;
        let stride = splats.sh_stride();
        for (splat, row) in splats.sh.chunks_mut(stride).enumerate() {
            row[[3, 48, 12, 27][splat % 4]..].fill(0.0);
        }
        // Coincident splats of different degree.
        for splat in (0..8_000).step_by(5) {
            splats.mean[splat + 1] = splats.mean[splat];
        }
        let whole = Splats {
            // Invisible but not zero, so that all splats have the highest degree.
            sh: splats.sh.iter().map(|&c| if c == 0.0 { 1e-30 } else { c }).collect(),
            ..splats.clone()
        };
        let render = |splats: &Splats| {
            let model = Model::upload_as(&gpu, splats, precision).unwrap();
            let options = RenderOptions {
                precision,
                ..RenderOptions::default()
            };
            let mut renderer = Renderer::new(&gpu, options).unwrap();
            let view = ViewOptions {
                background: scene.options.background.map(|c| c as f32),
                near: scene.options.near as f32,
                filter: splats.filter,
            };
            let image = renderer.render(&model, &scene.camera, &view).unwrap();
            (model, image)
        };
        let (model, image) = render(&scene.splats);
        // 2,250 splats of each degree, in separate blocks.
        assert_eq!(model.counts, [2_250; 4]);
        assert!(!model.splat_from_slot.is_empty());
        let bytes: u64 = model.params.iter().map(Buffer::bytes).sum();
        let of = |degree| 2_250 * precision.splat_bytes(degree) as u64;
        assert_eq!(bytes, (0..4).map(of).sum::<u64>());
        let (model, expected) = render(&whole);
        assert_eq!(model.counts, [0, 0, 0, 9_000]);
        assert!(model.splat_from_slot.is_empty());
        assert!(image.rgb == expected.rgb, "another picture as {precision:?}");
        assert!(image.transmittance == expected.transmittance);
    }
}

#[test]
fn a_renderer_refuses_a_model_that_it_would_misread() {
    let gpu = crate::common::device::gpu();
    let scene = crate::common::scenes::gentle(25, 5, 16, 16, 0);
    let model = Model::upload_as(&gpu, &scene.splats, Precision::Half).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let view = ViewOptions {
        background: [0.0; 3],
        near: 0.1,
        filter: scene.splats.filter,
    };
    let refused = renderer.render(&model, &scene.camera, &view);
    let message = refused.err().map(|e| e.to_string()).unwrap_or_default();
    assert!(message.contains("lies on the device as Half"), "{message}");
}
