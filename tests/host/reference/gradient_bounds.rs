//! Error bounds of approximate gradients hold for every parameter, and are attained to a stated share.

use crate::common::scenes::{self, Random, Scene};
use ashfall::reference::bound::{Approximations, GradientBounds, Rounding, gradient_bounds};
use ashfall::reference::gradient::{SplatGradients, backward};
use ashfall::reference::rasterize_backward::PixelGradient;
use ashfall::reference::{Options, Thresholds};

/// Gradient of a linear function of the picture: random weights of either sign per pixel and channel.
fn upstream(scene: &Scene) -> Vec<[f64; 3]> {
    let random = &mut Random::new(9);
    let pixels = scene.camera.width * scene.camera.height;
    (0..pixels).map(|_| [0; 3].map(|_| random.between(-1.0, 1.0))).collect()
}

fn exact(scene: &Scene, thresholds: Thresholds) -> SplatGradients {
    let pixel = |color| PixelGradient {
        color,
        ..PixelGradient::default()
    };
    let upstream: Vec<PixelGradient> = upstream(scene).into_iter().map(pixel).collect();
    let options = Options {
        thresholds,
        ..scene.options
    };
    backward(&scene.splats, &scene.camera, &options, &upstream).1
}

/// Rounding of the oracle in f64.
const ROUNDING: Rounding = Rounding {
    share: 1e-9,
    unit: 1.0 / (1u64 << 53) as f64,
};

fn bounds(scene: &Scene, approximations: &[Approximations]) -> GradientBounds {
    gradient_bounds(
        &scene.splats,
        &scene.camera,
        &scene.options,
        &upstream(scene),
        approximations,
        ROUNDING,
    )
}

/// The values of each group of parameters, flattened.
fn groups(g: &SplatGradients) -> [(&'static str, Vec<f64>); 5] {
    [
        ("mean", g.mean.as_flattened().to_vec()),
        ("quaternion", g.quaternion.as_flattened().to_vec()),
        ("log-scale", g.log_scale.as_flattened().to_vec()),
        ("opacity", g.opacity_logit.clone()),
        ("harmonics", g.sh.clone()),
    ]
}

/// Asserts that no error exceeds its bound, and that in each group some error reaches `tightness` of it.
#[track_caller]
fn judge(
    name: &str,
    exact: &SplatGradients,
    found: &SplatGradients,
    bound: &SplatGradients,
    rounding: &SplatGradients,
    tightness: f64,
) {
    let all = groups(exact).into_iter().zip(groups(found));
    let allowed = groups(bound).into_iter().zip(groups(rounding));
    for (((group, exact), (_, found)), ((_, bound), (_, rounding))) in all.zip(allowed) {
        let mut closest: f64 = 0.0;
        for i in 0..exact.len() {
            let error = (found[i] - exact[i]).abs();
            // The oracle's own rounding, including that of cancelling terms.
            let slack = 1e-12 * exact[i].abs() + rounding[i];
            assert!(
                error <= bound[i] + slack,
                "{name}, {group} {i}: {error:e} > {:e}, of {:e}",
                bound[i],
                exact[i]
            );
            if error > 2.0 * slack {
                closest = closest.max(error / bound[i]);
            }
        }
        println!("{name}, {group}: {closest:.3} of the bound");
        assert!(closest >= tightness, "{name}, {group}: errors reach {closest} of it");
    }
}

#[test]
fn gradients_under_cuts_and_stops_keep_to_their_bounds() {
    for scene in [scenes::gentle(71, 60, 32, 24, 2), scenes::hard(72, 90, 33, 25, 1)] {
        let whole = exact(&scene, Thresholds::NONE);
        for (alpha_min, transmittance_min) in [(1.0 / 255.0, 1e-4), (1.0 / 16.0, 1e-9), (1e-6, 0.1)] {
            let approximations = Approximations {
                alpha_min,
                transmittance_min,
                ..Approximations::NONE
            };
            let promised = bounds(&scene, &[approximations]);
            let thresholds = Thresholds {
                alpha_min,
                transmittance_min,
                ..Thresholds::ENGINE
            };
            let name = format!("cut {alpha_min:.1e}, stop {transmittance_min:.1e}");
            let found = exact(&scene, thresholds);
            let GradientBounds { bounds, rounding, .. } = &promised;
            judge(&name, &whole, &found, &bounds[0], rounding, 0.05);
        }
    }
}

#[test]
fn gradients_without_some_splats_keep_to_their_bounds() {
    let scene = scenes::gentle(73, 50, 30, 22, 1);
    let removed: Vec<bool> = (0..scene.splats.len()).map(|i| i % 4 == 0).collect();
    let gone = Approximations {
        removed: removed.clone(),
        ..Approximations::NONE
    };
    let whole = exact(&scene, Thresholds::NONE);
    let mut fewer = scene.clone();
    for (logit, gone) in fewer.splats.opacity_logit.iter_mut().zip(&removed) {
        if *gone {
            *logit = f32::NAN;
        }
    }
    let promised = bounds(&scene, &[gone]);
    let found = exact(&fewer, Thresholds::NONE);
    judge("fewer", &whole, &found, &promised.bounds[0], &promised.rounding, 0.05);
}

#[test]
fn gradients_of_splats_of_one_depth_do_not_depend_on_their_order() {
    let mut scene = scenes::gentle(74, 20, 20, 20, 0);
    let mean = scene.splats.mean[0];
    scene.splats.mean.fill(mean);
    let promised = bounds(&scene, &[Approximations::NONE]);
    let mut turned = scene.clone();
    turned.splats.quaternion.reverse();
    turned.splats.log_scale.reverse();
    turned.splats.opacity_logit.reverse();
    turned.splats.sh = scene.splats.sh.chunks(3).rev().flatten().copied().collect();
    let whole = exact(&scene, Thresholds::NONE);
    let mut back = exact(&turned, Thresholds::NONE);
    back.mean.reverse();
    back.quaternion.reverse();
    back.log_scale.reverse();
    back.opacity_logit.reverse();
    back.sh = back.sh.chunks(3).rev().flatten().copied().collect();
    let GradientBounds { bounds, rounding, .. } = &promised;
    judge("order", &whole, &back, &bounds[0], rounding, 1e-3);
}

#[test]
fn without_savings_nothing_but_rounding_is_allowed() {
    let scene = scenes::hard(75, 60, 24, 24, 1);
    let promised = bounds(&scene, &[Approximations::NONE]);
    for (group, bound) in groups(&promised.bounds[0]) {
        // The scene has splats at the cap of alpha, where the gradient is discontinuous.
        let idle = bound.iter().filter(|b| **b == 0.0).count();
        assert!(2 * idle > bound.len(), "{group}: {idle} of {}", bound.len());
    }
    // The rounding bound is proportional to the given rounding.
    let (fine, coarse) = (
        groups(&promised.rounding),
        groups(&{
            gradient_bounds(
                &scene.splats,
                &scene.camera,
                &scene.options,
                &upstream(&scene),
                &[],
                Rounding {
                    share: 2.0 * ROUNDING.share,
                    unit: 2.0 * ROUNDING.unit,
                },
            )
            .rounding
        }),
    );
    for ((_, fine), (_, coarse)) in fine.iter().zip(&coarse) {
        for (fine, coarse) in fine.iter().zip(coarse) {
            assert!((coarse - 2.0 * fine).abs() <= 1e-3 * coarse);
        }
    }
}
