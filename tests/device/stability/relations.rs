//! Metamorphic relations between pictures, without a reference.

use crate::common::scenes::{self, Random, Scene};
use crate::stability::lab::{U, image_bound, lab, same, within};
use crate::stability::props::{OPAQUE, Prop, picked, place, stage};
use ashfall::reference::DiscontinuityMargin;
use ashfall::reference::frame::discontinuity_margins;
use ashfall::render::RenderedImage;
use ashfall::scene::ScreenFilter;
use glam::{DMat3, DQuat, DVec3, Vec2Swizzles as _};

fn exact_margins(scene: &Scene) -> Vec<DiscontinuityMargin> {
    discontinuity_margins(&scene.splats, &scene.camera, &scene.options)
}

/// Largest difference of two pictures over the pixels farther than `margin` from a discontinuity.
fn interior(scene: &Scene, a: &RenderedImage, b: &RenderedImage, margin: f64) -> f64 {
    let mut worst = 0.0f64;
    for (i, at) in exact_margins(scene).iter().enumerate() {
        if at.nearest() > margin {
            for c in 0..3 {
                worst = worst.max((f64::from(a.rgb[i][c]) - f64::from(b.rgb[i][c])).abs());
            }
            worst = worst.max((f64::from(a.transmittance[i]) - f64::from(b.transmittance[i])).abs());
        }
    }
    worst
}

/// The scene after a rigid motion of everything.
fn moved(scene: &Scene, turn: DQuat, by: DVec3) -> Scene {
    let mut other = scene.clone();
    for mean in &mut other.splats.mean {
        let p = turn * DVec3::from(mean.map(f64::from)) + by;
        *mean = p.to_array().map(|x| x as f32);
    }
    for q in &mut other.splats.quaternion {
        let [w, x, y, z] = q.map(f64::from);
        let r = turn * DQuat::from_xyzw(x, y, z, w);
        *q = [r.w, r.x, r.y, r.z].map(|x| x as f32);
    }
    other.camera.position = turn * scene.camera.position + by;
    other.camera.rotation = scene.camera.rotation * DMat3::from_quat(turn).transpose();
    other
}

#[test]
fn m01_rigid_motion() {
    let lab = lab();
    let scene = scenes::gentle(201, 40, 64, 48, 0);
    let clean = lab.draw(&scene);
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 1.9);
    for distance in [10.0, 1e3] {
        let other = moved(&scene, turn, DVec3::new(0.6, -0.64, 0.48) * distance);
        // Means and the camera's position are rounded again, by U |t| an axis: on the screen that is at most 3 f U |t|
        // / z for both, and z is 2 at least. Rotations too: 3U of the image's size.
        let focal = scene.camera.focal.max_element();
        let pixel = 3.0 * focal * U * (distance + 8.0) / 2.0 + 6.0 * 64.0 * U;
        let bound = 0.61 / 0.55 * pixel + image_bound(64, 0.55, 40, 1.0);
        // An exponent of up to 5.55 has the slope 3.33 / σ.
        let margin = 3.33 / 0.55 * pixel + 1e-4;
        let error = interior(&scene, &lab.draw(&other), &clean, margin);
        within("frame", "M1", &format!("rigid motion by {distance}"), error, bound);
    }
}

#[test]
fn m02_scale() {
    let lab = lab();
    let scene = scenes::hard(202, 54, 64, 48, 2);
    let clean = lab.draw(&scene);
    for power in [-20i32, -10, 10, 20] {
        let factor = 2f64.powi(power);
        let mut scaled = scene.clone();
        scaled.camera.position *= factor;
        scaled.options.near *= factor;
        for x in scaled.splats.mean.iter_mut().flatten() {
            *x *= factor as f32;
        }
        for x in scaled.splats.log_scale.iter_mut().flatten() {
            *x = (f64::from(*x) + factor.ln()) as f32;
        }
        // Log-scales of up to 8 + 14 round by half an ULP, 16U; a covariance changes by twice that, an alpha by 1/e of
        // it.
        let bound = 0.74 * 16.0 * U + 4.0 * U;
        let error = interior(&scene, &lab.draw(&scaled), &clean, 1e-4);
        within("frame", "M2", &format!("everything times 2^{power}"), error, bound);
    }
}

#[test]
fn m03_permutation() {
    let lab = lab();
    let scene = scenes::gentle(203, 60, 48, 40, 1);
    let order = Random::new(203).permutation(60);
    let other = Scene {
        splats: picked(&scene.splats, &order),
        ..scene.clone()
    };
    assert!(
        same(&lab.draw(&scene), &lab.draw(&other)),
        "the order of the list shows"
    );
}

/// Two halves of a picture; splats are so small that those visible in a half are within that half's limits.
#[test]
fn m04_halves() {
    let lab = lab();
    let mut scene = stage(64, 40);
    let random = &mut Random::new(204);
    for i in 0..150 {
        let prop = Prop {
            depth: 2.0 + f64::from(i) * 0.02,
            color: [0; 3].map(|_| random.between(0.1, 0.9)),
            ..Prop::ball([random.between(0.0, 64.0), random.between(0.0, 40.0)], 1.1, 1.0)
        };
        place(&mut scene, &prop);
    }
    let whole = lab.draw(&scene);
    let margins = exact_margins(&scene);
    let mut worst = 0.0f64;
    for half in 0..2usize {
        let mut part = scene.clone();
        part.camera.width = 32;
        part.camera.center.x -= 32.0 * half as f64;
        let image = lab.draw(&part);
        for i in 0..32 * 40 {
            let at = i / 32 * 64 + i % 32 + 32 * half;
            if margins[at].nearest() > 1e-4 {
                for c in 0..3 {
                    worst = worst.max(f64::from((image.rgb[i][c] - whole.rgb[at][c]).abs()));
                }
            }
        }
    }
    // The principal point is added at another step: one rounding at the image's size.
    let sigma = (1.1f64 * 1.1 + 0.3).sqrt();
    let bound = 0.61 / sigma * 64.0 * 2.0 * U + 4.0 * U;
    within("frame", "M4", "two halves", worst, bound);
}

/// The 2 × 2 average of a picture at twice the size equals the picture at the usual size: nearly so for Mip-Splatting,
/// not for the usual dilation, which is recorded as its known defect.
#[test]
fn m07_double_size() {
    let lab = lab();
    let side = 64usize;
    let alpha = |image: &RenderedImage, i: usize| 1.0 - f64::from(image.transmittance[i]);
    // Standard deviation at the usual size, and the largest error of a pixel: that of sampling a Gaussian at a pixel's
    // centre instead of over its area, measured in double precision for the catalogue.
    for (sigma, bound) in [(0.2, 4.8e-2), (0.5, 3.5e-2), (1.0, 1.6e-2), (2.0, 8e-3), (8.0, 1e-3)] {
        let mut light = Vec::new();
        let mut worst = 0.0f64;
        for filter in [ScreenFilter::Mip, ScreenFilter::Classic] {
            // Positions of the centre within a pixel, which matter for narrow splats.
            let (mut total, mut total_large) = (0.0, 0.0);
            for place_in_pixel in 0..16 {
                let [x, y] = [place_in_pixel % 4, place_in_pixel / 4].map(|k| f64::from(k) / 4.0 + 32.1);
                let mut scene = stage(side as u32, side as u32);
                place(&mut scene, &Prop::ball([x, y], sigma, OPAQUE));
                scene.splats.filter = filter;
                let mut large = scene.clone();
                large.camera = scene.camera.resized(2 * side as u32, 2 * side as u32);
                let (small, large) = (lab.draw(&scene), lab.draw(&large));
                for i in 0..side * side {
                    let corner = 4 * (i / side) * side + 2 * (i % side);
                    let four = [0, 1, 2 * side, 2 * side + 1].map(|k| alpha(&large, corner + k));
                    let mean = four.iter().sum::<f64>() / 4.0;
                    total += alpha(&small, i);
                    total_large += mean;
                    if filter == ScreenFilter::Mip {
                        worst = worst.max((alpha(&small, i) - mean).abs());
                    }
                }
            }
            light.push(total / total_large - 1.0);
        }
        let what = |what: &str| format!("{what}, σ {sigma} px");
        // At the rim, up to three of the four pixels are below 1/255, or the pixel is and their mean is not.
        let bound = bound + 1.0 / 255.0;
        within("frame", "M7", &what("mip at double size"), worst, bound);
        // Both pictures lack their rim below 1/255: a share of 1/255 of an opaque splat's light, and fainter,
        // compensated small ones lack more of theirs, 1 / (255 · 0.16) at σ = 0.2.
        let peak = (sigma * sigma / (sigma * sigma + 0.1)).min(1.0);
        within(
            "frame",
            "M7",
            &what("light, mip"),
            light[0].abs(),
            3e-3 + 1.0 / 255.0 / peak,
        );
        println!(
            "| frame | M7 | {} | {:.1e} | - |",
            what("light, usual dilation (known defect)"),
            light[1]
        );
    }
}

/// Rotation by a third of a turn about the diagonal permutes the axes, and the scales with them.
#[test]
fn m12_axes() {
    let lab = lab();
    let scene = scenes::gentle(212, 30, 48, 40, 0);
    let mut other = scene.clone();
    for (q, s) in other.splats.quaternion.iter_mut().zip(&mut other.splats.log_scale) {
        let [w, x, y, z] = q.map(f64::from);
        let turned = DQuat::from_xyzw(x, y, z, w) * DQuat::from_xyzw(0.5, 0.5, 0.5, 0.5);
        *q = [turned.w, turned.x, turned.y, turned.z].map(|x| x as f32);
        // R' e_x = R e_y, and so on.
        *s = [s[1], s[2], s[0]];
    }
    // A quaternion rounds again by 2U, which an aspect of up to 2.7 makes 2.7² · 2 · 5.55 · 2U of an exponent.
    let bound = 2.7f64.powi(2) * 2.0 * 5.55 * 2.0 * U + image_bound(48, 1.0, 30, 1.0);
    let error = interior(&scene, &lab.draw(&other), &lab.draw(&scene), 1e-4);
    within("project", "M12", "axes exchanged", error, bound);
}

/// The scene and the camera mirrored at the diagonal of the picture.
fn transposed(scene: &Scene) -> Scene {
    let mirror = DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z);
    let mut other = scene.clone();
    let camera = &mut other.camera;
    (camera.width, camera.height) = (camera.height, camera.width);
    (camera.focal, camera.center) = (camera.focal.yx(), camera.center.yx());
    for (mean, q) in other.splats.mean.iter_mut().zip(&mut other.splats.quaternion) {
        mean.swap(0, 1);
        let [w, x, y, z] = q.map(f64::from);
        let turned = mirror * DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        // An ellipsoid is its own mirror image: reversing one axis makes a rotation of it.
        let turned = DMat3::from_cols(turned.x_axis, turned.y_axis, -turned.z_axis);
        let r = DQuat::from_mat3(&turned);
        *q = [r.w, r.x, r.y, r.z].map(|x| x as f32);
    }
    other
}

#[test]
fn m13_transposition() {
    let lab = lab();
    let mut scene = stage(61, 40);
    scene.camera.focal.y *= 1.125;
    scene.camera.center.x += 3.5;
    let random = &mut Random::new(213);
    for i in 0..60 {
        let prop = Prop {
            depth: 2.0 + f64::from(i) * 0.05,
            sigma: [0; 3].map(|_| random.log_between(0.7, 6.0)),
            quaternion: [0; 4].map(|_| random.normal()),
            color: [0; 3].map(|_| random.between(0.1, 0.9)),
            ..Prop::ball([random.between(0.0, 61.0), random.between(0.0, 40.0)], 1.0, 0.5)
        };
        place(&mut scene, &prop);
    }
    let (upright, turned) = (lab.draw(&scene), lab.draw(&transposed(&scene)));
    let mut worst = 0.0f64;
    for (i, at) in exact_margins(&scene)
        .iter()
        .enumerate()
        .filter(|(_, at)| at.nearest() > 1e-3)
    {
        let there = i % 61 * 40 + i / 61;
        for c in 0..3 {
            worst = worst.max(f64::from((upright.rgb[i][c] - turned.rgb[there][c]).abs()));
        }
        assert!(at.nearest() > 0.0);
    }
    // Quaternions of aspect up to 8.6 are rounded again: as in M12.
    let bound = 8.6f64.powi(2) * 2.0 * 5.55 * 2.0 * U + 2.0 * image_bound(61, 0.55, 60, 1.0);
    within("frame", "M13", "the picture transposed", worst, bound);
}
