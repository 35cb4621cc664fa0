//! Accuracy gained by the engine's numerics, first part: ellipses. The error of the usual formula, computed here in
//! single precision, beside the error of the device on the same inputs, both against double precision.

use crate::common::scenes::{Random, Scene};
use crate::stability::bounds::touched_tiles;
use crate::stability::conic::{alpha_errors, factor, needle, on_screen};
use crate::stability::lab::{flat_gradient, lab, percentile, rows};
use crate::stability::projection::{clamped, gradient_errors};
use crate::stability::props::{OPAQUE, Prop, place, stage};
use ashfall::layout::{TILE_HEIGHT, TILE_WIDTH};
use ashfall::reference::frame::center;
use ashfall::reference::linear::{covariance, product};
use ashfall::reference::rasterize::raw_alpha;
use ashfall::reference::{ScreenSplat, Splat, Viewpoint, project, rasterize_inria};
use ashfall::scene::ScreenFilter;

/// Prints the errors of a naive formula and of the device on the same inputs, and asserts that the device's is within
/// its bound and smaller.
#[track_caller]
pub(crate) fn gained(number: u32, what: &str, naive: f64, ours: f64, bound: f64) {
    println!("| B{number:02} | {what} | {naive:.1e} | {ours:.1e} | {bound:.1e} |");
    assert!(ours <= bound, "B{number}: {what}: {ours:e}, more than {bound:e}");
    assert!(
        naive > ours,
        "B{number}: {what}: the naive form loses {naive:e}, no more than {ours:e}"
    );
}

/// Projection of the scene's first splat in plain single precision, by full matrices.
pub(crate) fn naive_screen(scene: &Scene) -> Option<ScreenSplat<f32>> {
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    project(&Splat::<f32>::of(&scene.splats, 0), &view)
}

/// Alpha errors by the inverse of the covariance and its determinant as ac − b².
fn naive_alpha_errors(scene: &Scene) -> Vec<f64> {
    let (Some(exact), Some(naive)) = (on_screen(scene), naive_screen(scene)) else {
        return Vec::new();
    };
    let width = scene.camera.width as usize;
    let pixels = 0..width * scene.camera.height as usize;
    let errors = pixels.filter_map(|i| {
        let at = center(i, width);
        let alpha = raw_alpha(&exact, at);
        // A non-finite alpha is drawn at the cap, or not at all.
        let found = f64::from(raw_alpha(&naive, at));
        let found = if found.is_finite() { found.clamp(0.0, 1.0) } else { 1.0 };
        (alpha > 1.02 / 255.0).then_some((found - alpha).abs())
    });
    errors.collect()
}

/// Gradient by log-scales of a single white splat over black under a uniform pixel gradient, by way of the inverse
/// covariance as in the 3DGS code.
fn naive_needle_gradient(scene: &Scene) -> Option<[f64; 3]> {
    let naive = naive_screen(scene)?;
    let [a, b, c] = naive.covariance;
    let denominator = a * c - b * b;
    let (conic_a, conic_b, conic_c) = (c / denominator, -b / denominator, a / denominator);
    let width = scene.camera.width as usize;
    let count = width * scene.camera.height as usize;
    let [mut d_a, mut d_b, mut d_c] = [0.0f32; 3];
    for i in 0..count {
        let at = center(i, width);
        let [dx, dy] = [0, 1].map(|k| naive.mean[k] - at[k] as f32);
        let power = -0.5 * (conic_a * dx * dx + conic_c * dy * dy) - conic_b * dx * dy;
        let alpha = naive.opacity * power.exp();
        if power > 0.0 || alpha.is_nan() || alpha < 1.0 / 255.0 {
            continue;
        }
        let pull = alpha / count as f32;
        d_a += -0.5 * dx * dx * pull;
        d_b += -0.5 * dx * dy * pull;
        d_c += -0.5 * dy * dy * pull;
    }
    let inverse_square = 1.0 / (denominator * denominator + 1e-7);
    let by_a = inverse_square * (-c * c * d_a + 2.0 * b * c * d_b + (denominator - a * c) * d_c);
    let by_c = inverse_square * (-a * a * d_c + 2.0 * a * b * d_b + (denominator - a * c) * d_a);
    let by_b = inverse_square * 2.0 * (b * c * d_a - (denominator + 2.0 * b * b) * d_b + a * b * d_c);
    let [row_x, row_y] = factor(&Splat::<f64>::of(&scene.splats, 0), scene).map(|r| r.map(|x| x as f32));
    Some([0, 1, 2].map(|k| {
        let (x, y) = (row_x[k], row_y[k]);
        f64::from(2.0 * by_a * x * x + 2.0 * by_b * x * y + 2.0 * by_c * y * y)
    }))
}

#[test]
fn b01_whitened_residual() {
    for (aspect, bound) in [(1e2, 5e-5), (1e3, 1e-4), (1e4, 1e-4)] {
        let (mut naive, mut ours) = (Vec::new(), Vec::new());
        let random = &mut Random::new(901);
        for _ in 0..20 {
            let scene = needle(random, aspect, ScreenFilter::Classic, 96);
            naive.extend(naive_alpha_errors(&scene));
            ours.extend(alpha_errors(&scene));
        }
        let what = format!("alpha, aspect {aspect:.0e}, 99 %");
        gained(
            1,
            &what,
            percentile(&mut naive, 0.99),
            percentile(&mut ours, 0.99),
            bound,
        );
    }
    let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    for aspect in [1e2, 1e3] {
        let (mut naive, mut ours) = (Vec::new(), Vec::new());
        let random = &mut Random::new(902);
        for _ in 0..16 {
            let mut scene = needle(random, aspect, ScreenFilter::Classic, 48);
            // Half transparent, so that all alphas are below the cap; long σ up to the picture's size.
            scene.splats.opacity_logit[0] = 0.0;
            let long = random.log_between(3.0, 60.0) * 4.0 / scene.camera.focal.x;
            scene.splats.log_scale[0] = [long / aspect, long, long / aspect].map(|s| s.ln() as f32);
            let mine = gradient_errors(&scene, 7..10);
            let exact = &rows(&flat_gradient(&scene, scene.options.near as f32, 1.0))[0][7..10];
            if let (Some(found), [error]) = (naive_needle_gradient(&scene), mine.as_slice()) {
                let apart = [0, 1, 2].map(|k| found[k] - exact[k]);
                naive.push(length(&apart) / length(exact));
                ours.push(*error);
            }
        }
        let what = format!("gradient by log-scale, aspect {aspect:.0e}, largest");
        gained(1, &what, percentile(&mut naive, 1.0), percentile(&mut ours, 1.0), 1e-3);
    }
}

/// A clamped slope keeps its derivative by z; the 3DGS code uses the derivative of the unclamped one.
#[test]
fn b04_gradient_of_the_limit() {
    let scene = clamped(315);
    let exact = rows(&flat_gradient(&scene, scene.options.near as f32, 1.0));
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let pixels = (scene.camera.width * scene.camera.height) as usize;
    let upstream = vec![
        ashfall::reference::rasterize_backward::PixelGradient {
            color: [1.0 / (3 * pixels) as f64; 3],
            ..Default::default()
        };
        pixels
    ];
    let (by_screen, _) =
        ashfall::reference::gradient::backward(&scene.splats, &scene.camera, &scene.options, &upstream);
    let mut naive = Vec::new();
    for (i, row) in exact.iter().enumerate() {
        let splat = Splat::<f64>::of(&scene.splats, i);
        // The camera is upright at the origin: world is view.
        let [x, y, z] = splat.mean;
        let focal = scene.camera.focal;
        let slope = [
            (x / z).clamp(view.limit[0], view.limit[1]),
            (y / z).clamp(view.limit[2], view.limit[3]),
        ];
        let jacobian = [
            [focal.x / z, 0.0, -focal.x * slope[0] / z],
            [0.0, focal.y / z, -focal.y * slope[1] / z],
            [0.0; 3],
        ];
        let [_, _, xx, xy, yy, ..] = by_screen[i].row;
        let g = [[xx, 0.5 * xy, 0.0], [0.5 * xy, yy, 0.0], [0.0; 3]];
        let d_jacobian = product(product(g, jacobian), covariance(splat.quaternion, splat.log_scale));
        let mut extra = 0.0;
        if slope[0] != x / z {
            extra += 2.0 * d_jacobian[0][2] * focal.x * slope[0] / (z * z);
        }
        if slope[1] != y / z {
            extra += 2.0 * d_jacobian[1][2] * focal.y * slope[1] / (z * z);
        }
        let length = row[..3].iter().map(|g| g * g).sum::<f64>().sqrt();
        if length > 0.0 {
            naive.push(extra.abs() / length);
        }
    }
    let mut ours = gradient_errors(&scene, 0..3);
    for (what, share) in [("median", 0.5), ("largest", 1.0)] {
        let what = format!("means' gradient beyond the limit, {what}");
        gained(
            4,
            &what,
            percentile(&mut naive, share),
            percentile(&mut ours, share),
            1e-3,
        );
    }
}

#[test]
fn b05_bounds() {
    let lab = lab();
    let mut ball = stage(96, 96);
    place(&mut ball, &Prop::ball([40.3, 40.3], 8.0, OPAQUE));
    let exact = on_screen(&ball).unwrap();
    let [columns, rows] = rasterize_inria::square(&exact);
    let image = lab.draw(&ball);
    let (mut naive, mut ours) = (0.0f64, 0.0f64);
    for i in 0..96 * 96 {
        let at = center(i, 96);
        let alpha = raw_alpha(&exact, at);
        let lost = (alpha - 1.0 / 255.0).max(0.0);
        let within = |x: f64, (first, end): (f64, f64)| (first..end).contains(&(x / 16.0).floor());
        if !(within(at[0], columns) && within(at[1], rows)) {
            naive = naive.max(lost);
        }
        if image.transmittance[i] == 1.0 {
            ours = ours.max(lost);
        }
    }
    gained(
        5,
        "alpha over 1/255 outside the bounds of an opaque splat",
        naive,
        ours,
        1e-6,
    );
    for aspect in [10.0, 100.0] {
        let random = &mut Random::new(905);
        let (mut squares, mut listed, mut touched) = (0.0, 0.0, 0.0);
        for _ in 0..25 {
            let scene = needle(random, aspect, ScreenFilter::Classic, 512);
            let Some(exact) = on_screen(&scene) else {
                continue;
            };
            let spans = rasterize_inria::square(&exact);
            let tiles =
                |(first, end): (f64, f64), tile: u32| (end.min(32.0) - first.min(32.0)) * 16.0 / f64::from(tile);
            squares += tiles(spans[0], TILE_WIDTH) * tiles(spans[1], TILE_HEIGHT);
            listed += f64::from(lab.records(&scene).1[0]);
            touched += f64::from(touched_tiles(&exact, 512));
        }
        let what = format!("tiles listed for each touched, aspect {aspect}");
        gained(5, &what, squares / touched, listed / touched, 1.1);
    }
}
