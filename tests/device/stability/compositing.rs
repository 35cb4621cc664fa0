//! Section 6 of the catalogue: compositing.
//!
//! * 59: nothing is accumulated in half precision: there is no preview target of 16 bits.

use crate::common::scenes::{self, Random, Scene};
use crate::stability::lab::{Lesson, U, apart, difference, flat_gradient, image_bound, lab, rows, same, within};
use crate::stability::props::{OPAQUE, Prop, logit, place, stage, with_copy};
use ashfall::gpu::DeviceKind;
use ashfall::io::png::to_byte;
use ashfall::layout::ALPHA_MAX;
use ashfall::reference::frame::{center, project_all, sorted};
use ashfall::reference::rasterize::{layer, raw_alpha};
use ashfall::reference::{ScreenSplat, Splat, Thresholds, Viewpoint, frame};
use glam::{DQuat, DVec3};

/// A NaN alpha is not drawn as an opaque splat.
#[test]
fn f052_nan_alpha() {
    let lab = lab();
    let scene = scenes::gentle(652, 12, 33, 25, 1);
    let clean = lab.draw(&scene);
    let none = f32::NAN;
    for poison in 0..4 {
        let odd = with_copy(&scene, |splats, i| match poison {
            0 => splats.opacity_logit[i] = none,
            1 => splats.quaternion[i] = [none, 0.0, 0.0, 0.0],
            2 => splats.log_scale[i][2] = none,
            _ => *splats.sh.last_mut().unwrap() = none,
        });
        assert!(same(&lab.draw(&odd), &clean), "poison {poison} shows");
    }
}

/// A red wall lets 2^-16 of the colour behind it through.
#[test]
fn f053_alpha_cap() {
    let lab = lab();
    let mut scene = stage(40, 33);
    let wall = |depth, color| Prop {
        depth,
        color,
        ..Prop::ball([20.0, 16.0], 4000.0, OPAQUE)
    };
    place(&mut scene, &wall(1.0, [1.0, 0.0, 0.0]));
    place(&mut scene, &wall(2.0, [0.0, 0.0, 1.0]));
    let image = lab.draw(&scene);
    let leak = image.rgb.iter().map(|c| f64::from(c[2])).fold(0.0, f64::max);
    // The cap itself, and the wall's curvature: 20 px of 4,000 are 1.3e-5 of an exponent.
    within(
        "rasterize",
        "53",
        "blue behind an opaque red wall",
        leak,
        2f64.powi(-16) + 2e-5,
    );
    assert!(
        image.transmittance.iter().all(|&t| t > 0.0),
        "some must pass, or no gradient could"
    );
}

/// A single pixel fully covered by splats of the given opacities, nearest first.
pub(crate) fn column(opacities: &[f64], seed: u64) -> Scene {
    let mut scene = stage(1, 1);
    let random = &mut Random::new(seed);
    for (i, &opacity) in opacities.iter().enumerate() {
        let prop = Prop {
            depth: 1.0 + i as f64 / 256.0,
            color: [0; 3].map(|_| random.between(0.0, 1.0)),
            ..Prop::ball([0.5, 0.5], 1000.0, if opacity < 1.0 { logit(opacity) } else { OPAQUE })
        };
        place(&mut scene, &prop);
    }
    scene
}

/// No gradient through the capped alpha; the exact gradient right below the cap.
#[test]
fn f054_gradient_of_the_cap() {
    let lab = lab();
    let below = f64::from(ALPHA_MAX) - 2e-5;
    for (opacity, capped) in [(1.0, true), (below, false)] {
        let scene = column(&[opacity, 0.7], 654);
        let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
        let exact = &rows(&flat_gradient(&scene, stepped.near, 1.0))[0];
        let found = stepped.row(0);
        assert_eq!(exact[10] == 0.0, capped, "the oracle at opacity {opacity}");
        if capped {
            assert!(
                found[..11].iter().all(|&g| g == 0.0),
                "a gradient through the cap: {found:?}"
            );
        } else {
            // 1 − α is 3.5e-5 there, of which alpha's own rounding is U / 3.5e-5.
            let error = (found[10] / exact[10] - 1.0).abs();
            within(
                "rasterize_backward",
                "54",
                "opacity's gradient below the cap",
                error,
                10.0 * U / 3.5e-5,
            );
        }
    }
}

/// Random opacities of a column, some of them saturated.
fn opacities(random: &mut Random) -> Vec<f64> {
    let strength = random.between(0.3, 3.0);
    (0..60)
        .map(|_| random.between(0.001, 1.0).powf(strength).min(0.99999))
        .collect()
}

/// Error of the transmittance threshold: at most its value.
#[test]
fn f055_stop_includes_the_last() {
    let lab = lab();
    let random = &mut Random::new(655);
    let mut worst = 0.0f64;
    for seed in 0..40 {
        let mut scene = column(&opacities(random), seed);
        let image = lab.draw(&scene);
        scene.options.thresholds.transmittance_min = 0.0;
        let whole = frame::render(&scene.splats, &scene.camera, &scene.options);
        for c in 0..3 {
            worst = worst.max((f64::from(image.rgb[0][c]) - whole.pixels[0].color[c]).abs());
        }
    }
    // Colours lie between 0 and 1.
    within(
        "rasterize",
        "55",
        "left out behind the stop",
        worst,
        1e-4 + image_bound(1, 1000.0, 60, 1.0),
    );
}

/// Error of both thresholds: at most the dropped weights at each pixel.
#[test]
fn f056_what_the_cut_costs() {
    let lab = lab();
    let mut scene = scenes::gentle(656, 150, 48, 40, 0);
    // Faint splats among them, with rims that are a large part.
    for logit in scene.splats.opacity_logit.iter_mut().step_by(2) {
        *logit = -4.0;
    }
    let image = lab.draw(&scene);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let (list, _) = sorted(&project_all(&Splat::<f64>::all(&scene.splats), &view));
    let mut without = scene.clone();
    without.options.thresholds = Thresholds::NONE;
    let whole = frame::render(&without.splats, &without.camera, &without.options);
    let (mut beyond, mut most) = (f64::NEG_INFINITY, 0.0f64);
    for (i, pixel) in whole.pixels.iter().enumerate() {
        let (mut through, mut dropped, mut range) = (1.0, 0.0, 1.0f64);
        for splat in &list {
            let alpha = raw_alpha(splat, center(i, 48)).min(Thresholds::ENGINE.alpha_max);
            // Slightly above the threshold: rounding may drop a splat that lies on it.
            if alpha < Thresholds::ENGINE.alpha_min * 1.0001 {
                dropped += alpha * through;
            }
            range = splat.color.iter().fold(range, |m, &c| m.max(c));
            through *= 1.0 - alpha;
        }
        for c in 0..3 {
            let error = (f64::from(image.rgb[i][c]) - pixel.color[c]).abs();
            most = most.max(error);
            beyond = beyond.max(error - range * (dropped + 1e-4));
        }
    }
    println!("| rasterize | 56 | error of the cut at 1/255, faint scene | {most:.1e} | - |");
    within(
        "rasterize",
        "56",
        "error beyond the weights dropped",
        beyond,
        image_bound(48, 0.55, 150, 1.5),
    );
}

/// Largest error of `∂C/∂αᵢ` relative to Tᵢ over a column of `count` splats with final transmittance `through`.
pub(crate) fn column_gradient_error(count: usize, through: f64) -> f64 {
    let lab = lab();
    let each = 1.0 - through.powf(1.0 / count as f64);
    let scene = column(&vec![each; count], 657);
    let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
    let exact = rows(&flat_gradient(&scene, stepped.near, 1.0));
    let mut worst = 0.0f64;
    for (i, exact) in exact.iter().enumerate() {
        let before = (1.0 - each).powi(i as i32);
        let error = (stepped.row(i)[10] - exact[10]).abs() / (each * (1.0 - each));
        worst = worst.max(error / before);
    }
    worst
}

#[test]
fn f057_backward_transmittance() {
    for count in [1, 10, 100, 1000] {
        for through in [0.5, 1e-2, 2e-4] {
            let what = format!("dC/dα over T, {count} splats, T {through:.0e}");
            // n products forward, n quotients back, n sums over the splats behind: 3 √n U at random, and the
            // exponential's 7 ULP in each alpha of the same value, n · 14U · α / (1 − α) of T.
            within(
                "rasterize_backward",
                "57",
                &what,
                column_gradient_error(count, through),
                1e-5 * 5.0,
            );
        }
    }
}

/// The transmittance recovered by the backward pass at the front of a column equals the initial one of the forward
/// pass: both use the same alphas.
#[test]
fn f058_forward_and_backward_agree() {
    let lab = lab();
    // As processors do.
    let divides_exactly = lab.gpu().caps().kind == DeviceKind::Cpu;
    for count in [10usize, 100, 1000] {
        let each = 1.0 - 2e-4f64.powf(1.0 / count as f64);
        let scene = column(&vec![each; count], 658);
        let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
        // dL/d(first colour) = α T / 3 · basis, with T = 1 and α the opacity's alpha.
        let exact = &rows(&flat_gradient(&scene, stepped.near, 1.0))[0];
        let error = (stepped.row(0)[11] / exact[11] - 1.0).abs();
        // Products and quotients by the same factors: 2n roundings of either sign, √2n of them left; an inconsistent
        // alpha would cost 2U / (1 − α) each, n times with one sign. Vulkan permits quotients to be off by 2.5 ULP, all
        // with one sign.
        let quotients = if divides_exactly { 0.0 } else { 5.0 * count as f64 };
        let bound = (3.0 * (2.0 * count as f64).sqrt() + 20.0 + quotients) * U;
        within(
            "rasterize_backward",
            "58",
            &format!("T regained in front of {count} splats"),
            error,
            bound,
        );
    }
}

/// Conversion to bytes rounds to nearest: no bias over a ramp.
#[test]
fn f060_rounding_to_bytes() {
    for level in 0..=255u8 {
        let exact = f32::from(level) / 255.0;
        assert_eq!(to_byte(exact), level);
        for (step, expected) in [(-0.49, level), (0.49, level), (0.51, level.saturating_add(1))] {
            assert_eq!(
                to_byte((f32::from(level) + step) / 255.0),
                expected,
                "{level} and {step}"
            );
        }
    }
    let steps = 100_000;
    let values = (0..=steps).map(|i| i as f32 / steps as f32);
    let bias = values
        .map(|x| f64::from(to_byte(x)) - f64::from(x) * 255.0)
        .sum::<f64>()
        / f64::from(steps);
    within("output", "60", "bias of bytes, levels", bias.abs(), 1e-3);
    assert_eq!([to_byte(f32::NAN), to_byte(-1.0), to_byte(2.0)], [0, 0, 255]);
}

/// Every picture writes every pixel, including uncovered ones.
#[test]
fn f061_every_pixel_is_written() {
    let lab = lab();
    for (width, height) in [(1, 1), (9, 17), (40, 33)] {
        let bright = scenes::gentle(661, 40, width, height, 0);
        lab.draw(&bright);
        let mut empty = bright.clone();
        empty.splats.opacity_logit.fill(-9.0);
        let image = lab.draw(&empty);
        let background = empty.options.background.map(|c| c as f32);
        assert!(
            image.rgb.iter().all(|&c| c == background),
            "{width} × {height}: something is left over"
        );
        assert!(image.depth.iter().all(|&d| d == 0.0) && image.depth.len() == image.rgb.len());
    }
}

/// Splats are sorted by their centres, so a rotation of the camera may swap two: the change is recorded and bounded
/// only by the colour range.
#[test]
fn f062_popping() {
    let lab = lab();
    let scene = scenes::gentle(662, 200, 64, 48, 0);
    let mut turned = scene.clone();
    let yaw = DQuat::from_axis_angle(DVec3::Y, 0.01f64.to_radians());
    turned.camera.rotation = glam::DMat3::from_quat(yaw) * scene.camera.rotation;
    let jump = difference(&lab.draw(&scene), &lab.draw(&turned));
    within("model", "62", "popping by a turn of 0.01°", jump, 1.5);
}

/// Alphas over the whole range of the exponential.
#[test]
fn f063_exponential() {
    let lab = lab();
    let mut scene = stage(1024, 16);
    // A tile's column shares one residual, each row has its own: some 16,000 exponents from 0 to −5.54.
    let sigma = [1000.0 / 3.4, 900.0 / 3.4, 1.0];
    place(
        &mut scene,
        &Prop {
            sigma,
            ..Prop::ball([3.1, 7.77], 1.0, OPAQUE)
        },
    );
    let image = lab.draw(&scene);
    let (records, _) = lab.records(&scene);
    let seen: ScreenSplat<f64> = crate::common::pack::screen_splat(&records[0]);
    let (mut worst, mut count) = (0.0f64, 0);
    for (i, through) in image.transmittance.iter().enumerate() {
        if let Some(exact) = layer(&seen, center(i, 1024), &Thresholds::ENGINE).filter(|l| l.alpha > 1.01 / 255.0) {
            // The transmittance rounds by U at every alpha.
            let found = 1.0 - f64::from(*through);
            worst = worst.max(((found - exact.alpha).abs() - U) / exact.alpha);
            count += 1;
        }
    }
    assert!(count > 10_000, "{count} alphas");
    // 3 + 2 |x| ULP of the exponential, and an exponent of up to 8 that is a difference of terms of that size: 2
    // roundings of 8 and the residual's own.
    within(
        "rasterize",
        "63",
        "alpha, relative",
        worst,
        (3.0 + 2.0 * 8.0) * 2.0 * U + 4.0 * 8.0 * U,
    );
    assert!(apart(&scene, &image, 1e-3) < 1e-5);
}
