//! The thresholds of compositing: their errors, and the pixels that they may flip.

use crate::common::scenes::{self, Random};
use crate::reference::metamorphic::{draw, on_screen};
use ashfall::reference::frame::{center, discontinuity_margins, sorted};
use ashfall::reference::rasterize::blended;
use ashfall::reference::{Splat, Thresholds, Viewpoint, frame};

/// The error of the transmittance threshold is at most its value times the colour range.
#[test]
fn the_cuts_cost_what_they_promise() {
    let mut scene = scenes::hard(41, 90, 30, 26, 0);
    scene.splats.opacity_logit.iter_mut().for_each(|o| *o += 2.0);
    let mut range: f64 = 1.0;
    for splat in on_screen(&scene).iter().flatten() {
        range = splat.color.into_iter().fold(range, f64::max);
    }
    scene.options.thresholds = Thresholds {
        transmittance_min: 0.0,
        ..Thresholds::ENGINE
    };
    let unstopped = draw(&scene);
    for transmittance_min in [1e-4, 4e-3, 0.1] {
        scene.options.thresholds.transmittance_min = transmittance_min;
        for (stopped, full) in draw(&scene).pixels.iter().zip(&unstopped.pixels) {
            for channel in 0..3 {
                let error = (stopped.color[channel] - full.color[channel]).abs();
                assert!(error <= transmittance_min * range, "{error} at {transmittance_min}");
            }
        }
    }
}

/// Single precision flips only pixels with a small margin.
#[test]
fn pixels_that_flip_were_in_the_band() {
    for seed in 0..4 {
        let scene = scenes::gentle(42 + seed, 60, 48, 40, 1);
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let plain = frame::render_splats(&Splat::<f32>::all(&scene.splats), &view, &scene.options);
        let margins = discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
        let mut near_margin = 0;
        for ((single, exact), margin) in plain.pixels.iter().zip(draw(&scene).pixels).zip(&margins) {
            if margin.nearest() < 1e-4 {
                near_margin += 1;
                continue;
            }
            for channel in 0..3 {
                let error = f64::from(single.color[channel]) - exact.color[channel];
                assert!(error.abs() < 2e-5, "{error} with {margin:?}");
            }
        }
        assert!(near_margin < margins.len() / 20, "{near_margin} pixels excused");
    }
}

/// A pixel's margin is exactly the relative change of a threshold at which its blended splats change.
#[test]
fn a_band_is_the_distance_to_its_threshold() {
    let mut scene = scenes::gentle(46, 150, 40, 36, 0);
    scene.splats.opacity_logit.iter_mut().for_each(|o| *o += 2.0);
    let margins = discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
    let (list, _) = sorted(&on_screen(&scene));
    let order: Vec<usize> = (0..list.len()).collect();
    let step = 0.05;
    let (mut by_alpha, mut by_transmittance) = (0, 0);
    for (index, margin) in margins.iter().enumerate() {
        let position = center(index, 40);
        let with = |thresholds: Thresholds| blended(&list, &order, position, &thresholds);
        let usual = with(Thresholds::ENGINE);
        let flips =
            |change: &dyn Fn(f64) -> Thresholds| with(change(1.0 - step)) != usual || with(change(1.0 + step)) != usual;
        let alpha = flips(&|factor| Thresholds {
            alpha_min: factor * Thresholds::ENGINE.alpha_min,
            ..Thresholds::ENGINE
        });
        let transmittance = flips(&|factor| Thresholds {
            transmittance_min: factor * Thresholds::ENGINE.transmittance_min,
            ..Thresholds::ENGINE
        });
        assert_eq!(alpha, margin.alpha_min <= step, "pixel {index}: {margin:?}");
        if transmittance {
            assert!(margin.transmittance <= step, "pixel {index}: {margin:?}");
        }
        by_alpha += usize::from(alpha);
        by_transmittance += usize::from(transmittance);
    }
    assert!(
        by_alpha > 20 && by_transmittance > 2,
        "{by_alpha} and {by_transmittance} flips"
    );
}

/// Perturbed depths change the order only at pixels with near ties.
#[test]
fn a_band_knows_of_near_ties() {
    let scene = scenes::gentle(47, 300, 30, 30, 0);
    let random = &mut Random::new(47);
    let margins = discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
    let (list, _) = sorted(&on_screen(&scene));
    let order: Vec<usize> = (0..list.len()).collect();
    let mut shaken: Vec<(f64, usize)> = (0..list.len())
        .map(|i| (list[i].depth * (1.0 + random.between(-2e-3, 2e-3)), i))
        .collect();
    shaken.sort_by(|a, b| a.0.total_cmp(&b.0));
    let other: Vec<usize> = shaken.into_iter().map(|(_, i)| i).collect();
    let mut flips = 0;
    for (index, margin) in margins.iter().enumerate() {
        let position = center(index, 30);
        let thresholds = Thresholds::ENGINE;
        if blended(&list, &order, position, &thresholds) != blended(&list, &other, position, &thresholds) {
            assert!(margin.order <= 4.1e-3, "{margin:?}");
            flips += 1;
        }
    }
    assert!(flips > 5, "{flips} flips");
}
