//! The cuts of compositing: what they cost, and which pixels they may flip.

use crate::metamorphic::{draw, on_screen};
use crate::scenes::{self, Random};
use ashfall::reference::frame::{bands, center, sorted};
use ashfall::reference::rasterize::blended;
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

/// A band is exactly as wide as the change of a threshold that it takes to change what a pixel blends.
#[test]
fn a_band_is_the_distance_to_its_threshold() {
    let mut scene = scenes::gentle(46, 150, 40, 36, 0);
    scene
        .splats
        .opacity_logit
        .iter_mut()
        .for_each(|o| *o += 2.0);
    let bands = bands(&scene.splats, &scene.camera, &scene.options);
    let (list, _) = sorted(&on_screen(&scene));
    let order: Vec<usize> = (0..list.len()).collect();
    let step = 0.05;
    let (mut by_alpha, mut by_transmittance) = (0, 0);
    for (index, band) in bands.iter().enumerate() {
        let position = center(index, 40);
        let with = |cuts: Cuts| blended(&list, &order, position, &cuts);
        let usual = with(Cuts::ENGINE);
        let flips = |change: &dyn Fn(f64) -> Cuts| {
            with(change(1.0 - step)) != usual || with(change(1.0 + step)) != usual
        };
        let alpha = flips(&|factor| Cuts {
            alpha_min: factor * Cuts::ENGINE.alpha_min,
            ..Cuts::ENGINE
        });
        let transmittance = flips(&|factor| Cuts {
            transmittance_min: factor * Cuts::ENGINE.transmittance_min,
            ..Cuts::ENGINE
        });
        assert_eq!(alpha, band.alpha_min <= step, "pixel {index}: {band:?}");
        if transmittance {
            assert!(band.transmittance <= step, "pixel {index}: {band:?}");
        }
        by_alpha += usize::from(alpha);
        by_transmittance += usize::from(transmittance);
    }
    assert!(
        by_alpha > 20 && by_transmittance > 2,
        "{by_alpha} and {by_transmittance} flips"
    );
}

/// Depths that are shaken change the order only where neighbours were near each other.
#[test]
fn a_band_knows_of_near_ties() {
    let scene = scenes::gentle(47, 300, 30, 30, 0);
    let random = &mut Random::new(47);
    let bands = bands(&scene.splats, &scene.camera, &scene.options);
    let (list, _) = sorted(&on_screen(&scene));
    let order: Vec<usize> = (0..list.len()).collect();
    let mut shaken: Vec<(f64, usize)> = (0..list.len())
        .map(|i| (list[i].depth * (1.0 + random.between(-2e-3, 2e-3)), i))
        .collect();
    shaken.sort_by(|a, b| a.0.total_cmp(&b.0));
    let other: Vec<usize> = shaken.into_iter().map(|(_, i)| i).collect();
    let mut flips = 0;
    for (index, band) in bands.iter().enumerate() {
        let position = center(index, 30);
        let cuts = Cuts::ENGINE;
        if blended(&list, &order, position, &cuts) != blended(&list, &other, position, &cuts) {
            assert!(band.order <= 4.1e-3, "{band:?}");
            flips += 1;
        }
    }
    assert!(flips > 5, "{flips} flips");
}
