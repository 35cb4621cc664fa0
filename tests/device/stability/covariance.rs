//! Section 1 of the catalogue: quaternions, scales, covariances.

use crate::common::scenes::{self, Random, Scene};
use crate::stability::lab::{Lesson, U, difference, flat_gradient, image_bound, lab, rows, same, within};
use crate::stability::optimiser::Run;
use crate::stability::props::{OPAQUE, Prop, logit, place, stage, with_copy};
use ashfall::layout::TILE_PIXELS;
use ashfall::train::{HostState, Trainer};

/// The scene with quaternions multiplied by a factor.
fn turned_longer(scene: &Scene, factor: f32) -> Scene {
    let mut longer = scene.clone();
    for q in longer.splats.quaternion.iter_mut().flatten() {
        *q *= factor;
    }
    longer
}

/// A zero quaternion is not drawn, in particular not as opaque; a short one is drawn.
#[test]
fn f001_zero_quaternion() {
    let lab = lab();
    let scene = scenes::gentle(101, 20, 48, 40, 1);
    let clean = lab.draw(&scene);
    for length in [0.0f32, -0.0, 1e-38, 1e-20, 9e-19] {
        let broken = with_copy(&scene, |splats, i| {
            splats.quaternion[i] = [length, 0.0, 0.0, 0.0];
            splats.opacity_logit[i] = logit(0.1);
        });
        assert!(
            same(&lab.draw(&broken), &clean),
            "a quaternion of length {length:e} shows"
        );
    }
    let broken = with_copy(&scene, |splats, i| splats.quaternion[i] = [0.0; 4]);
    let stepped = lab.step(&broken, &Lesson::photo(&scene, 0.2));
    assert!(
        stepped.row(20).iter().all(|&g| g == 0.0),
        "a gradient of what is not drawn"
    );
    // Scaled by its largest component first, a quaternion keeps a relative error of about 6U at every length: an
    // angle that turns an ellipse of aspect 2 by 6U changes an exponent of up to 5.55 by 4 · 5.55 · 6U.
    let short = lab.draw(&turned_longer(&scene, 1e-10));
    let bound = 4.0 * 5.55 * 6.0 * U + image_bound(48, 1.0, 20, 1.0);
    within(
        "project",
        "1",
        "quaternions of length 1e-10",
        difference(&short, &clean),
        bound,
    );
}

#[test]
fn f002_large_quaternion() {
    let lab = lab();
    let scene = scenes::gentle(102, 30, 48, 40, 0);
    let clean = lab.draw(&scene);
    for power in [60, -50, 100] {
        let scaled = turned_longer(&scene, 2f32.powi(power));
        assert!(same(&lab.draw(&scaled), &clean), "quaternions times 2^{power}");
    }
    // As in entry 1.
    let bound = 4.0 * 5.55 * 6.0 * U + image_bound(48, 1.0, 30, 1.0);
    let long = lab.draw(&turned_longer(&scene, 1e30));
    within(
        "project",
        "2",
        "quaternions of length 1e30",
        difference(&long, &clean),
        bound,
    );
}

/// The gradient by the unnormalised quaternion is exact, and orthogonal to it.
#[test]
fn f003_unnormalised_quaternion_gradient() {
    let lab = lab();
    let mut scene = scenes::gentle(103, 25, 48, 40, 0);
    let random = &mut Random::new(3);
    for q in &mut scene.splats.quaternion {
        let factor = random.log_between(0.05, 20.0) as f32;
        *q = q.map(|x| x * factor);
    }
    let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
    let exact = flat_gradient(&scene, stepped.near, 1.0);
    let (mut along, mut off) = (0.0f64, 0.0f64);
    for (i, row) in rows(&exact).iter().enumerate() {
        let q = scene.splats.quaternion[i].map(f64::from);
        let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let (found, exact) = (&stepped.row(i)[3..7], &row[3..7]);
        let dot: f64 = q.iter().zip(found).map(|(a, b)| a * b).sum();
        along = along.max(dot.abs() / (length(&q) * length(found)));
        let error: Vec<f64> = found.iter().zip(exact).map(|(a, b)| a - b).collect();
        off = off.max(length(&error) / length(exact));
    }
    // The tangent projection leaves 8U of its input, which is at most a hundred times its result: a ball's rotation has
    // no gradient at all, and these have axes within 1 : 2.7.
    within(
        "project_backward",
        "3",
        "gradient along the quaternion",
        along,
        8.0 * U * 100.0,
    );
    // 99 % of this engine's gradients agree to 1e-4; smaller ones are noise of sums over pixels.
    within("project_backward", "3", "gradient by the quaternion", off, 1e-3);
}

/// Quaternion lengths do not grow, which would slow down learning.
#[test]
fn f004_quaternion_norm_drift() {
    let random = &mut Random::new(4);
    let lab = lab();
    let start = [3.0f32, -4.0, 0.5, 1.0];
    let mut run = Run::new(&lab, 1, start);
    let mut course = vec![start];
    for _ in 0..400 {
        // A random gradient tangent to the sphere.
        let q = course[course.len() - 1].map(f64::from);
        let g = [0; 4].map(|_| random.normal());
        let along: f64 = q.iter().zip(g).map(|(q, g)| q * g).sum();
        let square: f64 = q.iter().map(|q| q * q).sum();
        course.push(run.step([0, 1, 2, 3].map(|k| (g[k] - q[k] * along / square) as f32)));
    }
    assert_eq!(run.poisoned(), 0);
    let length = |q: &[f32; 4]| q.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    let drift = course[1..].iter().map(|q| (length(q) - 1.0).abs()).fold(0.0, f64::max);
    // One division and one square root a step, without accumulation.
    within("adam", "4", "length of a quaternion in training", drift, 4.0 * U);
    let angle = |pair: &[[f32; 4]]| {
        let square = (0..4).map(|k| f64::from(pair[1][k] - pair[0][k]).powi(2)).sum::<f64>();
        square.sqrt()
    };
    let mean = |part: &[[f32; 4]]| part.windows(2).map(angle).sum::<f64>() / (part.len() - 1) as f64;
    let (early, late) = (mean(&course[101..200]), mean(&course[301..400]));
    // Steps of random direction: a mean over 99 of them, which share their moments over about 10, scatters by
    // a tenth of the mean or so; |q| = 5 at the start, unnormalised, would have made it five times smaller.
    assert!(
        (late / early - 1.0).abs() < 0.4,
        "steps of {early:e}, later of {late:e}"
    );
}

/// The gradient by the view direction holds at every world unit.
#[test]
fn f005_direction_at_every_distance() {
    let lab = lab();
    let scene = scenes::gentle(105, 20, 40, 33, 3);
    let lesson = Lesson::flat(&scene, 0);
    let (clean, picture) = (lab.step(&scene, &lesson), lab.draw(&scene));
    let largest = clean.gradients[0].iter().flatten().fold(0.0f32, |m, g| m.max(g.abs()));
    for power in [-70, -30, 30, 70] {
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
        // A log-scale of up to 50 rounds by 50U at most, which changes a covariance by twice that, and an alpha by
        // 1/e of it.
        let bound = 0.74 * 55.0 * U + image_bound(40, 0.55, 20, 1.0);
        let error = difference(&lab.draw(&scaled), &picture);
        within(
            "project",
            "5",
            &format!("harmonics in units of 2^{power}"),
            error,
            bound,
        );
        let stepped = lab.step(&scaled, &lesson);
        let mut worst = 0.0f64;
        for (now, was) in stepped.gradients[0].iter().zip(&clean.gradients[0]) {
            for (&now, &was) in now[..3].iter().zip(was) {
                worst = worst.max((f64::from(now) * factor - f64::from(was)).abs());
            }
        }
        // Sums over some hundred pixels of either sign amplify the same rounding ten times.
        let (error, bound) = (worst / f64::from(largest), 10.0 * bound);
        within(
            "project_backward",
            "5",
            &format!("means' gradient in units of 2^{power}"),
            error,
            bound,
        );
    }
}

/// A splat's record is a factor of its covariance: the product is positive definite under any rounding, and accurate.
#[test]
fn f009_covariance_is_a_product() {
    let lab = lab();
    let mut scene = scenes::gentle(109, 600, 640, 480, 0);
    let random = &mut Random::new(9);
    for (i, log) in scene.splats.log_scale.iter_mut().enumerate() {
        let aspect = 10f64.powi((i % 7) as i32);
        let long = random.log_between(0.01, 3.0);
        *log = [long, long / aspect, long / aspect].map(|s| s.ln() as f32);
    }
    let (records, tiles) = lab.records(&scene);
    let viewpoint = ashfall::reference::Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let mut worst = 0.0f64;
    for (i, record) in records.iter().enumerate().filter(|(i, _)| tiles[*i] > 0) {
        let found = crate::common::pack::screen_splat(record).covariance;
        assert!(
            found[0] > 0.0 && found[0] * found[2] - found[1] * found[1] > 0.0,
            "splat {i}: {found:?}"
        );
        let exact = ashfall::reference::project(&ashfall::reference::Splat::<f64>::of(&scene.splats, i), &viewpoint)
            .unwrap()
            .covariance;
        // Relative to the largest entry: the small ones of a needle are differences.
        let largest = exact[0].max(exact[2]);
        for (f, e) in found.iter().zip(exact) {
            worst = worst.max((f - e).abs() / largest);
        }
    }
    // The long axis carries the specification's exponential, 3 + 2 · 4.6 ULP or 25U, and V = J W R S some 15 roundings
    // more; a product of two carries both twice.
    within("project", "9", "covariance, aspects 1 to 1e6", worst, 80.0 * U);
}

/// A loss that favours only size gives a splat that covers everything, and finite numbers.
#[test]
fn f010_scale_gradients_saturate() {
    let lab = lab();
    let mut scene = stage(40, 33);
    place(&mut scene, &Prop::ball([20.0, 16.0], 2.0, 0.0));
    place(
        &mut scene,
        &Prop {
            sigma: [0.5, 20.0, 0.5],
            ..Prop::ball([10.0, 9.0], 1.0, OPAQUE)
        },
    );
    let lesson = Lesson::flat(&scene, 255);
    let dataset = crate::stability::lab::dataset(&scene, &lesson);
    let mut config = crate::stability::lab::config(&scene, 0.0);
    // The distance of 5,000 steps at the usual rate, in 250.
    config.rates.log_scale *= 20.0;
    let state = HostState::from_splats(&scene.splats, 0);
    let mut trainer = Trainer::from_state(lab.gpu(), &dataset, config, &state, crate::stability::lab::BEGUN).unwrap();
    let mut reports = Vec::new();
    for _ in 0..250 {
        reports.extend(trainer.step().unwrap());
    }
    reports.extend(trainer.finish().unwrap());
    let tiles = (40 * 33usize).div_ceil(TILE_PIXELS as usize) + 5;
    for report in &reports {
        assert!(report.loss.is_finite() && report.poisoned == 0, "{report:?}");
        assert!(report.isect_count <= 2 * tiles, "{report:?}");
    }
    let after = trainer.download().unwrap();
    assert!(
        after.params.iter().flatten().flatten().all(|x| x.is_finite()),
        "{:?}",
        after.params
    );
    assert!(
        after.max_scale(0) > 100.0,
        "it did not even grow: {}",
        after.max_scale(0)
    );
}
