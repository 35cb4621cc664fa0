//! Error bounds of approximate frames hold in every pixel, and are attained to a stated share.

use crate::common::scenes::{self, Scene};
use crate::reference::metamorphic::draw;
use ashfall::reference::bound::{Approximations, TracedPixel, color_errors, trace};
use ashfall::reference::frame::center;
use ashfall::reference::rasterize::{composite, layer};
use ashfall::reference::{Pixel, Splat, Thresholds, Viewpoint, frame};
use ashfall::scene::sh_coefficient_count;

fn cases() -> Vec<Scene> {
    vec![
        scenes::gentle(61, 80, 40, 30, 3),
        scenes::hard(62, 120, 33, 29, 3),
        scenes::hard(63, 90, 21, 40, 1),
    ]
}

fn full(scene: &Scene, approximations: &[Approximations]) -> Vec<TracedPixel> {
    trace(&scene.splats, &scene.camera, &scene.options, approximations)
}

/// Largest error over the channels.
fn error(pixel: &Pixel<f64>, traced: &TracedPixel) -> f64 {
    (0..3)
        .map(|c| (pixel.color[c] - traced.color[c]).abs())
        .fold(0.0, f64::max)
}

/// Asserts that the bound holds everywhere, and that some error reaches `tightness` of it.
#[track_caller]
fn judge(name: &str, pixels: &[Pixel<f64>], traced: &[TracedPixel], tightness: f64) {
    let mut closest: f64 = 0.0;
    for (i, (pixel, traced)) in pixels.iter().zip(traced).enumerate() {
        let (error, bound) = (error(pixel, traced), traced.bounds[0]);
        assert!(error <= bound + 1e-12, "{name}, pixel {i}: {error:e} > {bound:e}");
        if error > 1e-9 {
            closest = closest.max(error / bound);
        }
    }
    println!("{name}: {closest:.3} of the bound");
    assert!(closest >= tightness, "{name}: errors reach {closest} of it");
}

#[test]
fn without_savings_the_traced_frame_is_the_whole_one() {
    for mut scene in cases() {
        let traced = full(&scene, &[Approximations::NONE]);
        scene.options.thresholds = Thresholds::NONE;
        for (pixel, traced) in draw(&scene).pixels.iter().zip(&traced) {
            assert!(error(pixel, traced) < 1e-12);
            // The only remaining bound is that of splats too faint to be seen.
            assert!(traced.bounds[0] < 1e-7, "{}", traced.bounds[0]);
        }
    }
}

#[test]
fn cuts_and_stops_keep_to_their_bounds() {
    for mut scene in cases() {
        for (alpha_min, transmittance_min) in [(1.0 / 255.0, 1e-4), (1.0 / 32.0, 1e-9), (1e-6, 0.1), (0.1, 0.2)] {
            let approximations = Approximations {
                alpha_min,
                transmittance_min,
                ..Approximations::NONE
            };
            let traced = full(&scene, &[approximations]);
            scene.options.thresholds = Thresholds {
                alpha_min,
                transmittance_min,
                ..Thresholds::ENGINE
            };
            let name = format!("cut {alpha_min:.1e}, stop {transmittance_min:.1e}");
            judge(&name, &draw(&scene).pixels, &traced, 0.05);
        }
    }
}

#[test]
fn truncated_and_rounded_harmonics_keep_to_their_bounds() {
    for mut scene in cases() {
        scene.options.thresholds = Thresholds::NONE;
        for degree in 0..scene.splats.sh_degree {
            let kept = 3 * sh_coefficient_count(degree);
            let (sh, stride) = (scene.splats.sh.clone(), scene.splats.sh_stride());
            let stored = |i: usize| {
                if i % stride < kept { f64::from(sh[i]) } else { 0.0 }
            };
            let approximations = Approximations {
                color_error: color_errors(&scene.splats, stored),
                ..Approximations::NONE
            };
            let traced = full(&scene, &[approximations]);
            let mut shown = scene.clone();
            shown.options.sh_degree = degree;
            judge(&format!("degree {degree}"), &draw(&shown).pixels, &traced, 0.2);
        }
        let coarse = |i: usize| f64::from((scene.splats.sh[i] * 64.0).round() / 64.0);
        let approximations = Approximations {
            color_error: color_errors(&scene.splats, coarse),
            ..Approximations::NONE
        };
        let traced = full(&scene, &[approximations]);
        let mut shown = scene.clone();
        for value in &mut shown.splats.sh {
            *value = (*value * 64.0).round() / 64.0;
        }
        judge("rounded", &draw(&shown).pixels, &traced, 0.1);
    }
}

#[test]
fn removed_splats_keep_to_their_bounds() {
    for scene in cases() {
        let removed: Vec<bool> = (0..scene.splats.len()).map(|i| i % 3 == 0).collect();
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let screen = frame::project_all(&Splat::<f64>::all(&scene.splats), &view);
        let (list, splat_from_rank) = frame::sorted(&screen);
        let draw = |keep: &dyn Fn(usize) -> bool| -> Vec<Pixel<f64>> {
            let width = scene.camera.width as usize;
            let pixels = 0..width * scene.camera.height as usize;
            let pixel = |i| {
                let at = center(i, width);
                let kept = (0..list.len()).filter(|&rank| keep(rank));
                let layers = kept.filter_map(|rank| layer(&list[rank], at, &Thresholds::NONE));
                composite(layers, scene.options.background, 0.0).0
            };
            pixels.map(pixel).collect()
        };
        let fewer = draw(&|rank| !removed[splat_from_rank[rank]]);
        let gone = Approximations {
            removed,
            ..Approximations::NONE
        };
        judge("fewer", &fewer, &full(&scene, &[gone]), 0.1);
    }
}

#[test]
fn splats_of_one_depth_may_come_in_any_order() {
    // Fifty splats on one spot of the optical axis: the oracle orders them by index.
    let mut scene = scenes::gentle(64, 50, 24, 24, 0);
    let mean = scene.splats.mean[0];
    scene.splats.mean.fill(mean);
    scene.options.thresholds = Thresholds::NONE;
    let traced = full(&scene, &[Approximations::NONE]);
    let mut turned = scene.clone();
    turned.splats.quaternion.reverse();
    turned.splats.log_scale.reverse();
    turned.splats.opacity_logit.reverse();
    turned.splats.sh = scene.splats.sh.chunks(3).rev().flatten().copied().collect();
    let mut largest: f64 = 0.0;
    for (pixel, traced) in draw(&turned).pixels.iter().zip(&traced) {
        largest = largest.max(error(pixel, traced));
        assert!(error(pixel, traced) <= traced.order + 1e-12);
    }
    assert!(largest > 0.01, "the order does not matter here: {largest}");
}

#[test]
fn scenes_stored_in_fewer_digits_keep_to_their_bounds() {
    for mut scene in cases() {
        let mut stored = scene.splats.clone();
        let round = |value: &mut f32| *value = (*value * 32.0).round() / 32.0;
        stored.quaternion.as_flattened_mut().iter_mut().for_each(round);
        stored.log_scale.as_flattened_mut().iter_mut().for_each(round);
        stored.opacity_logit.iter_mut().for_each(round);
        let exact = Approximations {
            stored: Some(stored.clone()),
            ..Approximations::NONE
        };
        let cut = Approximations {
            alpha_min: 1.0 / 64.0,
            transmittance_min: 1e-2,
            ..exact.clone()
        };
        let traced = [full(&scene, &[exact]), full(&scene, &[cut])];
        scene.splats = stored;
        scene.options.thresholds = Thresholds::NONE;
        judge("shapes", &draw(&scene).pixels, &traced[0], 0.2);
        scene.options.thresholds = Thresholds {
            alpha_min: 1.0 / 64.0,
            transmittance_min: 1e-2,
            ..Thresholds::ENGINE
        };
        judge("shapes, cut", &draw(&scene).pixels, &traced[1], 0.1);
    }
}
