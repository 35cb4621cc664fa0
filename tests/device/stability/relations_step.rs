//! The metamorphic relations of training steps and their gradients.

use crate::common::scenes::{self, Random, Scene};
use crate::stability::lab::{BEGUN, Lab, Lesson, U, config, dataset, lab, same, within};
use crate::stability::optimiser::course;
use crate::stability::props::{OPAQUE, logit, with_copy};
use ashfall::reference::frame::render_splats;
use ashfall::reference::{Dual, Options, Real, Splat, Viewpoint};
use ashfall::scene::AlphaMode;
use ashfall::train::{HostState, PendingColors, Trainer};

/// Asserts that the splats added in `more` are invisible and change nothing, in the picture and in a step.
#[track_caller]
fn assert_unseen(lab: &Lab, name: &str, scene: &Scene, more: &Scene) {
    let lesson = Lesson::photo(scene, 0.2);
    let (clean, found) = (lab.step(scene, &lesson), lab.step(more, &lesson));
    assert!(same(&lab.draw(more), &lab.draw(scene)), "{name}: the picture changed");
    assert!(found.image == clean.image, "{name}: the image of the step changed");
    for splat in 0..more.splats.len() {
        match splat < scene.splats.len() {
            true => assert_eq!(found.row(splat), clean.row(splat), "{name}: a neighbour's gradient"),
            false => assert!(found.row(splat).iter().all(|&g| g == 0.0), "{name}: a gradient"),
        }
    }
}

#[test]
fn m05_the_unseen() {
    let lab = lab();
    let scene = scenes::gentle(205, 20, 40, 33, 1);
    let forward = scene.camera.rotation.row(2);
    let behind = (scene.camera.position - forward * 2.0).as_vec3().to_array();
    let sideways = scene.camera.rotation.row(0);
    let beside = (scene.camera.position + forward * 3.0 + sideways * 300.0)
        .as_vec3()
        .to_array();
    let mut more = scene.clone();
    for change in 0..4 {
        more = with_copy(&more, |splats, i| match change {
            0 => splats.opacity_logit[i] = logit(0.99 / 255.0),
            1 => splats.mean[i] = behind,
            2 => splats.mean[i] = beside,
            _ => splats.mean[i][1] = f32::NAN,
        });
    }
    assert_unseen(&lab, "unseen", &scene, &more);
    let shows = with_copy(&scene, |splats, i| splats.opacity_logit[i] = 0.0);
    assert!(!same(&lab.draw(&shows), &lab.draw(&scene)), "a healthy copy shows");
}

#[test]
fn m06_behind_an_opaque_stack() {
    let lab = lab();
    let mut scene = scenes::gentle(206, 20, 40, 33, 0);
    let axis = scene.camera.rotation.row(2);
    let at = |z: f64| (scene.camera.position + axis * z).as_vec3().to_array();
    let (walls, far) = ([at(1.0), at(0.9)], at(9.0));
    for wall in walls {
        scene = with_copy(&scene, |splats, i| {
            splats.mean[i] = wall;
            splats.log_scale[i] = [4.0; 3];
            splats.opacity_logit[i] = OPAQUE;
        });
    }
    let more = with_copy(&scene, |splats, i| splats.mean[i] = far);
    assert_unseen(&lab, "behind the wall", &scene, &more);
}

/// The gradient of a sum of losses is the sum of the gradients: the left half of a photograph, the right half, and
/// both.
#[test]
fn m08_linear_upstream() {
    let lab = lab();
    let scene = scenes::gentle(208, 25, 40, 33, 0);
    let pixels = 40 * 33;
    let lesson = |shown: &dyn Fn(usize) -> bool| Lesson {
        rgba: (0..pixels)
            .map(|i| {
                let level = if i % 40 < 17 { 0 } else { 255 };
                [level, level, level, if shown(i) { 255 } else { 0 }]
            })
            .collect(),
        alpha: AlphaMode::Mask,
        lambda: 0.0,
    };
    let left = lab.step(&scene, &lesson(&|i| i % 40 < 17));
    let right = lab.step(&scene, &lesson(&|i| i % 40 >= 17));
    let both = lab.step(&scene, &lesson(&|_| true));
    let (a, b, all) = (17.0 * 33.0, 23.0 * 33.0, f64::from(pixels as u32));
    let mut worst = 0.0f64;
    for splat in 0..25 {
        // Colour gradients: sums of pixels' weights of one sign in each half, so that the scale is the sum of their
        // magnitudes.
        for k in 11..14 {
            let (l, r) = (left.row(splat)[k] * a, right.row(splat)[k] * b);
            let error = (l + r - both.row(splat)[k] * all).abs();
            if l != 0.0 || r != 0.0 {
                worst = worst.max(error / (l.abs() + r.abs()));
            }
        }
    }
    // (n + 4) U of the magnitudes for n pixels.
    within(
        "rasterize_backward",
        "M8",
        "two halves of a loss",
        worst,
        (pixels + 4) as f64 * U,
    );
}

/// Moving all splats equals moving the camera the other way: the means' gradients sum to the derivative by a common
/// shift, computed by dual numbers.
#[test]
fn m09_noether() {
    let lab = lab();
    let scene = scenes::gentle(209, 25, 40, 33, 2);
    let stepped = lab.step(&scene, &Lesson::flat(&scene, 0));
    let options = Options {
        near: f64::from(stepped.near),
        ..scene.options
    };
    let view = Viewpoint::new(&scene.camera, &options, scene.splats.filter);
    let lifted: Vec<Splat<Dual<3>>> = Splat::<f64>::all(&scene.splats)
        .iter()
        .map(|splat| {
            let mut row: Vec<Dual<3>> = splat.parameters().into_iter().map(Dual::of).collect();
            for (axis, x) in row[..3].iter_mut().enumerate() {
                *x = Dual::variable(x.v, Some(axis));
            }
            Splat::from_parameters(&row)
        })
        .collect();
    let frame = render_splats(&lifted, &view, &options);
    let mut by_shift = [0.0; 3];
    for color in frame.pixels.iter().flat_map(|p| p.color) {
        for (sum, d) in by_shift.iter_mut().zip(color.d) {
            *sum += d / (3.0 * frame.pixels.len() as f64);
        }
    }
    let mut worst = 0.0f64;
    for (axis, by_shift) in by_shift.iter().enumerate() {
        let all = (0..25).map(|i| stepped.row(i)[axis]);
        let magnitude: f64 = all.clone().map(f64::abs).sum();
        worst = worst.max((all.sum::<f64>() - by_shift).abs() / magnitude);
    }
    // 8U of the terms of a splat's own gradient, which may be a hundred times as large as it.
    within(
        "project_backward",
        "M9",
        "sum of the means' gradients",
        worst,
        800.0 * U,
    );
}

#[test]
fn m10_euler() {
    let lab = lab();
    let scene = scenes::hard(210, 54, 48, 40, 1);
    let stepped = lab.step(&scene, &Lesson::photo(&scene, 0.2));
    let mut worst = 0.0f64;
    for (i, q) in scene.splats.quaternion.iter().enumerate() {
        let (q, g) = (q.map(f64::from), &stepped.row(i)[3..7]);
        let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let dot: f64 = q.iter().zip(g).map(|(q, g)| q * g).sum();
        if length(g) > 0.0 {
            worst = worst.max(dot.abs() / (length(&q) * length(g)));
        }
    }
    // 8U of the input of the tangent projection: up to a thousand times its result, for balls and needles seen from
    // their tips.
    within("project_backward", "M10", "q · dL/dq", worst, 8000.0 * U);
}

#[test]
fn m11_quaternions_length() {
    let lab = lab();
    let scene = scenes::gentle(211, 25, 40, 33, 1);
    let lesson = Lesson::photo(&scene, 0.2);
    let clean = lab.step(&scene, &lesson);
    for factor in [-1.0f32, 2f32.powi(60), -2f32.powi(-50)] {
        let mut other = scene.clone();
        for q in other.splats.quaternion.iter_mut().flatten() {
            *q *= factor;
        }
        let found = lab.step(&other, &lesson);
        assert!(found.image == clean.image, "quaternions times {factor:e}: the image");
        for (now, was) in found.gradients[1].iter().zip(&clean.gradients[1]) {
            assert_eq!(
                now.map(|g| g * factor),
                *was,
                "quaternions times {factor:e}: the gradient"
            );
        }
    }
}

fn train(lab: &Lab, scene: &Scene, parts: &[u32]) -> HostState {
    let lesson = Lesson::photo(scene, 0.2);
    let dataset = dataset(scene, &lesson);
    let mut state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
    let mut iteration = BEGUN;
    let mut colors = PendingColors::default();
    for steps in parts {
        let config = config(scene, 0.2);
        let mut trainer = Trainer::from_state(lab.gpu(), &dataset, config, &state, iteration).unwrap();
        trainer.set_pending_colors(&colors).unwrap();
        for _ in 0..*steps {
            trainer.step().unwrap();
        }
        state = trainer.download().unwrap();
        colors = trainer.pending_colors().unwrap();
        iteration = trainer.iteration();
    }
    state
}

/// The same run twice, and once more in two parts (M14 and M21).
#[test]
fn m14_twice_the_same() {
    let lab = lab();
    let scene = scenes::hard(214, 54, 40, 33, 1);
    assert!(same(&lab.draw(&scene), &lab.draw(&scene)), "two pictures of one scene");
    let once = train(&lab, &scene, &[100]);
    assert!(train(&lab, &scene, &[100]) == once, "a hundred steps, twice");
}

/// Gradients multiplied by a power of two give the same steps.
#[test]
fn m20_adam_has_no_scale() {
    let lab = lab();
    let random = &mut Random::new(220);
    let gradients: Vec<[f32; 4]> = (0..40).map(|_| [0; 4].map(|_| random.normal() as f32)).collect();
    let scaled = |factor: f32| -> Vec<[f32; 4]> { gradients.iter().map(|g| g.map(|g| g * factor)).collect() };
    let clean = course(&lab, &gradients);
    for power in [-20, 20] {
        assert_eq!(
            course(&lab, &scaled(2f32.powi(power))),
            clean,
            "gradients times 2^{power}"
        );
    }
}

#[test]
fn m21_continued() {
    let lab = lab();
    let scene = scenes::gentle(221, 30, 40, 33, 1);
    let whole = train(&lab, &scene, &[12]);
    assert!(train(&lab, &scene, &[5, 7]) == whole, "a run in two parts");
}
