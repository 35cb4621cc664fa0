//! Accuracy gained by the engine's numerics, third part: the loss, opacities, filters, bytes, sums, lengths and
//! regularisers.

use crate::common::scenes::{self, Random};
use crate::stability::conic::{exact_compensation, needle};
use crate::stability::lab::{Lesson, U, difference, flat_gradient, lab, percentile, rows};
use crate::stability::loss::bright_flat;
use crate::stability::numerics::{gained, naive_screen};
use crate::stability::projection::{gradient_errors, scaled};
use crate::stability::props::{Prop, place, stage};
use ashfall::io::png::to_byte;
use ashfall::reference::loss::{Target, loss};
use ashfall::reference::{Splat, relocate};
use ashfall::scene::ScreenFilter;
use ashfall::train::strategy::relocated;

/// Mean of 1 − SSIM in single precision, variances as E[x²] − E[x]².
fn naive_dissimilarity(width: usize, x: &[f32], y: &[f32]) -> f64 {
    let height = x.len() / width;
    let gauss = |t: i64| (-((t * t) as f32) / 4.5).exp();
    let norm: f32 = (-5..=5).map(gauss).sum();
    let mut total = 0.0;
    for i in 0..x.len() as i64 {
        let (column, row) = (i % width as i64, i / width as i64);
        let mut moments = [0.0f32; 5];
        for v in -5..=5 {
            for h in -5..=5 {
                let (a, b) = (column + h, row + v);
                if !(0..width as i64).contains(&a) || !(0..height as i64).contains(&b) {
                    continue;
                }
                let g = gauss(v) / norm * (gauss(h) / norm);
                let (x, y) = (x[b as usize * width + a as usize], y[b as usize * width + a as usize]);
                for (sum, term) in moments.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                    *sum += g * term;
                }
            }
        }
        let [mx, my, xx, yy, xy] = moments;
        let (vx, vy, cov) = (xx - mx * mx, yy - my * my, xy - mx * my);
        let ssim = (2.0 * mx * my + 1e-4) * (2.0 * cov + 9e-4) / ((mx * mx + my * my + 1e-4) * (vx + vy + 9e-4));
        total += 1.0 - f64::from(ssim);
    }
    total / x.len() as f64
}

#[test]
fn b08_shifted_variances() {
    let lab = lab();
    for amplitude in [0.6, 1.4] {
        let (scene, lesson) = bright_flat(amplitude);
        let level = |pixel: &[u8; 4]| f64::from(pixel[0]) / 255.0;
        let photo: Vec<[f64; 3]> = lesson.rgba.iter().map(|p| [level(p); 3]).collect();
        let image = vec![scene.options.background; photo.len()];
        let target = Target {
            lambda: 1.0,
            ..Target::new(64, &photo)
        };
        let exact: f64 = loss(&image, &target);
        let x = vec![scene.options.background[0] as f32; photo.len()];
        let y: Vec<f32> = photo.iter().map(|p| p[0] as f32).collect();
        let naive = (naive_dissimilarity(64, &x, &y) - exact).abs();
        let ours = (lab.step(&scene, &lesson).report.loss - exact).abs();
        gained(
            8,
            &format!("SSIM of a bright flat picture, noise of {amplitude} levels"),
            naive,
            ours,
            1e-5,
        );
    }
}

#[test]
fn b09_saturating_sigmoid() {
    let lab = lab();
    for logit in [10.0f32, 17.0, 20.0, 25.0] {
        // A pixel beside the centre, with alphas below the cap.
        let mut scene = stage(1, 1);
        place(&mut scene, &Prop::ball([2.0, 0.5], 1.0, logit));
        let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
        let exact = rows(&flat_gradient(&scene, stepped.near, 1.0))[0][10];
        let ours = (stepped.row(0)[10] / exact - 1.0).abs();
        let opacity = 1.0 / (1.0 + (-logit).exp());
        let exact_slope = 1.0 / (1.0 + f64::from(-logit).exp()) * (1.0 / (1.0 + f64::from(logit).exp()));
        let naive = (f64::from(opacity * (1.0 - opacity)) / exact_slope - 1.0).abs();
        gained(
            9,
            &format!("opacity's gradient at logit {logit}, relative"),
            naive,
            ours,
            100.0 * U,
        );
    }
}

#[test]
fn b10_compensation() {
    let lab = lab();
    for aspect in [1e2, 1e3, 1e4] {
        let random = &mut Random::new(910);
        let (mut naive, mut ours) = (Vec::new(), Vec::new());
        for _ in 0..60 {
            let scene = needle(random, aspect, ScreenFilter::Mip, 64);
            let (records, tiles) = lab.records(&scene);
            let exact = exact_compensation(&Splat::<f64>::of(&scene.splats, 0), &scene);
            if tiles[0] > 0 {
                // An opaque splat's opacity is its compensation.
                ours.push((f64::from(records[0].shape[3]).exp2() / exact - 1.0).abs());
                let found = naive_screen(&scene).map_or(f64::NAN, |s| f64::from(s.opacity));
                naive.push(if found.is_finite() {
                    (found / exact - 1.0).abs()
                } else {
                    1.0
                });
            }
        }
        let what = format!("mip compensation, aspect {aspect:.0e}, 99 %");
        gained(
            10,
            &what,
            percentile(&mut naive, 0.99),
            percentile(&mut ours, 0.99),
            120.0 * U,
        );
    }
}

#[test]
fn b11_rounded_bytes() {
    let random = &mut Random::new(911);
    // A picture of 40 dB: errors of a standard deviation of 0.01.
    let pairs: Vec<(f64, f64)> = (0..200_000)
        .map(|_| {
            let truth = random.between(0.1, 0.9);
            (truth, truth + 0.01 * random.normal())
        })
        .collect();
    let decibels = |shown: &dyn Fn(f64) -> f64| {
        let square: f64 = pairs.iter().map(|&(truth, found)| (shown(found) - truth).powi(2)).sum();
        -10.0 * (square / pairs.len() as f64).log10()
    };
    let float = decibels(&|x| x);
    let truncated = float - decibels(&|x| (x * 255.0).floor() / 255.0);
    let rounded = float - decibels(&|x| f64::from(to_byte(x as f32)) / 255.0);
    // A step's variance of 1 / (12 · 255²) beside that of 1e-4: 0.055 dB.
    gained(11, "decibels lost by 8 bits at 40 dB", truncated, rounded, 0.06);
}

/// The published double sum in single precision, and the opacity by a power.
fn naive_relocation(opacity: f64, copies: u32) -> (f64, f64) {
    let each = 1.0 - (1.0 - opacity as f32).powf(1.0 / copies as f32);
    let mut sum = 0.0f32;
    for i in 1..=copies {
        let mut binomial = 1.0f32;
        for k in 0..i {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += binomial * sign * each.powi(k as i32 + 1) / ((k + 1) as f32).sqrt();
            binomial *= (i - 1 - k) as f32 / (k + 1) as f32;
        }
    }
    (f64::from(each), f64::from(opacity as f32 / sum))
}

#[test]
fn b12_relocation() {
    for (opacity, copies) in [(0.005, 2), (0.05, 51), (0.99, 51)] {
        let exact = (
            relocate::opacity(opacity, copies),
            relocate::scale_factor(opacity, copies),
        );
        let error = |(each, factor): (f64, f64)| (each / exact.0 - 1.0).abs().max((factor / exact.1 - 1.0).abs());
        let (naive, ours) = (
            error(naive_relocation(opacity, copies)),
            error(relocated(opacity, copies)),
        );
        gained(
            12,
            &format!("{copies} copies of opacity {opacity}, relative"),
            naive,
            ours,
            1e-8,
        );
    }
}

#[test]
fn b13_sums_by_tiles() {
    let lab = lab();
    let mut scene = stage(256, 256);
    place(&mut scene, &Prop::ball([128.0, 128.0], 60.0, 0.0));
    let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
    let exact = rows(&flat_gradient(&scene, stepped.near, 1.0))[0][11];
    let ours = (stepped.row(0)[11] / exact - 1.0).abs();
    // Sequential sum over pixels in random order, as with unordered threads.
    let image = lab.draw(&scene);
    let each = 1.0 / (3.0 * 65_536.0) * ashfall::scene::SH_C0;
    let mut naive = 0.0f64;
    for seed in 0..4 {
        let (mut sum, mut whole) = (0.0f32, 0.0f64);
        for i in Random::new(seed).permutation(65_536) {
            let term = (1.0 - image.transmittance[i]) * each;
            sum += term;
            whole += f64::from(term);
        }
        naive = naive.max((f64::from(sum) / whole - 1.0).abs());
    }
    gained(13, "sum over 65,536 pixels, relative", naive, ours, 20.0 * U);
}

#[test]
fn b14_safe_lengths() {
    let lab = lab();
    let scene = scenes::gentle(914, 30, 48, 40, 0);
    let clean = lab.draw(&scene);
    for factor in [1e-17f32, 1e25] {
        let mut other = scene.clone();
        for q in other.splats.quaternion.iter_mut().flatten() {
            *q *= factor;
        }
        let ours = difference(&lab.draw(&other), &clean);
        // Squares in single precision: the length is 0 or infinite, and the rotation is lost.
        let mut naive = scene.clone();
        for (q, long) in naive.splats.quaternion.iter_mut().zip(&other.splats.quaternion) {
            let length = long.iter().map(|x| x * x).sum::<f32>().sqrt();
            *q = long.map(|x| x / length);
            if !(q.iter().all(|x| x.is_finite()) && q.iter().any(|&x| x != 0.0)) {
                *q = [1.0, 0.0, 0.0, 0.0];
            }
        }
        let naive = difference(&lab.draw(&naive), &clean);
        if factor > 1.0 {
            gained(
                14,
                &format!("picture with quaternions of length {factor:.0e}"),
                naive,
                ours,
                2e-5,
            );
        } else {
            assert!(ours < 2e-5, "{ours:e}");
        }
    }
    let far = scaled(&scenes::gentle(915, 20, 40, 33, 3), 2f64.powi(24));
    let ours = percentile(&mut gradient_errors(&far, 0..3), 0.5);
    // (|v|² d − v (v · d)) / √(|v|²)³, as in the 3DGS code, of v = (1, 2, 3) · 2²⁴ and d = (1, 0, 0).
    let v = [1.0f32, 2.0, 3.0].map(|x| x * 16_777_216.0);
    let square: f32 = v.iter().map(|x| x * x).sum();
    let found = (square - v[0] * v[0]) * (1.0 / (square * square * square).sqrt());
    let exact = (1.0 - 1.0 / 14.0) / (14f64.sqrt() * 16_777_216.0);
    let naive = (f64::from(found) / exact - 1.0).abs();
    gained(
        14,
        "gradient through a direction of length 6e7, relative",
        naive,
        ours,
        1e-4,
    );
}

#[test]
fn b15_no_regularisers() {
    let lab = lab();
    // Much smaller than a pixel, in mip mode: det = 0.1².
    let mut scene = stage(24, 20);
    scene.splats.filter = ScreenFilter::Mip;
    place(&mut scene, &Prop::ball([12.4, 10.3], 0.08, 3.0));
    let ours = percentile(&mut gradient_errors(&scene, 7..10), 1.0);
    let det: f64 = (0.08f64.powi(2) + 0.1).powi(2);
    let naive = 1.0 - det * det / (det * det + 1e-7);
    gained(15, "gradient of a splat of 0.08 px, relative", naive, ours, 100.0 * U);
    // A divisor of w + 1e-7 at depths of thousandths.
    let near = scaled(&scenes::gentle(916, 100, 640, 480, 0), 2f64.powi(-12));
    let (records, tiles) = lab.records(&near);
    let view = ashfall::reference::Viewpoint::new(&near.camera, &near.options, near.splats.filter);
    let (mut naive, mut ours) = (0.0f64, 0.0f64);
    for (i, record) in records.iter().enumerate().filter(|(i, _)| tiles[*i] > 0) {
        let exact = ashfall::reference::project(&Splat::<f64>::of(&near.splats, i), &view).unwrap();
        for axis in 0..2 {
            let offset = exact.mean[axis] - near.camera.center[axis];
            naive = naive.max((offset * 1e-7 / (exact.depth + 1e-7)).abs());
            ours = ours.max((f64::from(record.shape[axis]) - exact.mean[axis]).abs());
        }
    }
    // As in entry 20: a tenth of 8 · 4U / 2 · 1.2 · 640 px, and twice U of 640.
    gained(
        15,
        "position in units in which depths are thousandths, px",
        naive,
        ours,
        2e-4,
    );
}
