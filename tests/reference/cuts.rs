//! The cuts of compositing: what they cost, and which pixels they may flip.

use crate::metamorphic::{draw, on_screen};
use crate::scenes;
use ashfall::reference::frame::bands;
use ashfall::reference::{Cuts, Options, Splat, Viewpoint, frame};

/// What the stop leaves out is worth less than its threshold, and what the alpha cut leaves out is bounded too.
#[test]
fn the_cuts_cost_what_they_promise() {
    let mut scene = scenes::hard(41, 90, 30, 26, 0);
    scene
        .splats
        .opacity_logit
        .iter_mut()
        .for_each(|o| *o += 2.0);
    let mut range: f64 = 1.0;
    for splat in on_screen(&scene).iter().flatten() {
        range = splat.color.into_iter().fold(range, f64::max);
    }
    scene.options.cuts = Cuts {
        transmittance_min: 0.0,
        ..Cuts::ENGINE
    };
    let unstopped = draw(&scene);
    for transmittance_min in [1e-4, 4e-3, 0.1] {
        scene.options.cuts.transmittance_min = transmittance_min;
        for (stopped, full) in draw(&scene).pixels.iter().zip(&unstopped.pixels) {
            for channel in 0..3 {
                let error = (stopped.color[channel] - full.color[channel]).abs();
                assert!(
                    error <= transmittance_min * range,
                    "{error} at {transmittance_min}"
                );
            }
        }
    }
}

/// Single precision flips only pixels that were near flipping.
#[test]
fn pixels_that_flip_were_in_the_band() {
    for seed in 0..4 {
        let scene = scenes::gentle(42 + seed, 60, 48, 40, 1);
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.mode);
        let Options {
            background, cuts, ..
        } = scene.options;
        let plain =
            frame::render_splats(&Splat::<f32>::all(&scene.splats), &view, background, &cuts);
        let bands = bands(&scene.splats, &scene.camera, &scene.options);
        let mut banded = 0;
        for ((single, exact), band) in plain.pixels.iter().zip(draw(&scene).pixels).zip(&bands) {
            if band.nearest() < 1e-4 {
                banded += 1;
                continue;
            }
            for channel in 0..3 {
                let error = f64::from(single.color[channel]) - exact.color[channel];
                assert!(error.abs() < 2e-5, "{error} with {band:?}");
            }
        }
        assert!(banded < bands.len() / 20, "{banded} pixels excused");
    }
}
