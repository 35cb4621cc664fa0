//! Section 7 of the catalogue, second part: the optimiser.

use crate::common::scenes::{self, Random};
use crate::stability::lab::{BEGUN, Lesson, config, dataset, lab, within};
use crate::stability::optimiser::{BETAS, RATE, Run};
use crate::stability::props::{Prop, place, stage};
use ashfall::reference::adam::{Adam, AdamState};
use ashfall::train::strategy::{self, RefineContext, SplatStats};
use ashfall::train::{HostState, StrategyKind, TrainConfig, Trainer};

/// A nearly opaque splat becomes less opaque when the loss requires it.
#[test]
fn f071_saturated_opacity() {
    let lab = lab();
    let mut scene = stage(24, 20);
    place(&mut scene, &Prop::ball([12.0, 10.0], 3.0, 20.0));
    let lesson = Lesson::flat(&scene, 0);
    let dataset = dataset(&scene, &lesson);
    let mut config = config(&scene, 0.0);
    // Opacity alone: otherwise the splat could also shrink or darken.
    config.rates.log_scale = 0.0;
    config.rates.sh_dc = 0.0;
    let state = HostState::from_splats(&scene.splats, 0);
    let mut trainer = Trainer::from_state(lab.gpu(), &dataset, config, &state, BEGUN).unwrap();
    let mut course = Vec::new();
    for part in 0..5 {
        for _ in 0..100 {
            trainer.step().unwrap();
        }
        course.push(trainer.download().unwrap().params[0][0][3]);
        assert!(course[part].is_finite());
    }
    assert!(course[0] < 19.0 && course[4] < 0.0, "logits {course:?}");
}

/// Logits and logarithms are stored unconverted: a step of training reads the same bits.
#[test]
fn f072_logits_are_stored() {
    let lab = lab();
    let mut scene = scenes::gentle(772, 40, 24, 20, 1);
    for (i, logit) in scene.splats.opacity_logit.iter_mut().enumerate() {
        *logit = i as f32 * 1.000_001 - 5.0;
    }
    let lesson = Lesson::flat(&scene, 0);
    let dataset = dataset(&scene, &lesson);
    let state = HostState::from_splats(&scene.splats, 1);
    let mut trainer = Trainer::from_state(lab.gpu(), &dataset, config(&scene, 0.0), &state, BEGUN).unwrap();
    assert!(trainer.download().unwrap() == state, "not the same bits");
    assert_eq!(trainer.splats().unwrap().opacity_logit, scene.splats.opacity_logit);
}

/// The same parameters over time in double precision.
fn exact_course(gradients: &[[f32; 4]]) -> Vec<[f64; 4]> {
    let adam = Adam {
        beta1: f64::from(BETAS[0]),
        beta2: f64::from(BETAS[1]),
        epsilon: 1e-15,
    };
    let mut states = [AdamState::default(); 4];
    let mut course = Vec::new();
    for (step, gradient) in (1..).zip(gradients) {
        for (state, g) in states.iter_mut().zip(gradient) {
            *state = adam.step(*state, f64::from(*g), f64::from(RATE), step);
        }
        course.push(states.map(|s| s.value));
    }
    course
}

/// Largest error of the device's parameters over time, relative to the largest possible distance moved.
fn course_error(gradients: &[[f32; 4]]) -> f64 {
    let found = crate::stability::optimiser::course(&lab(), gradients);
    let mut worst = 0.0f64;
    for (step, (found, exact)) in (1..).zip(found.iter().zip(exact_course(gradients))) {
        for (f, e) in found.iter().zip(exact) {
            worst = worst.max((f64::from(*f) - e).abs() / (f64::from(RATE) * f64::from(step)));
        }
    }
    worst
}

/// A thousand steps, with gradients down to the magnitude of epsilon.
#[test]
fn f073_adam_in_double() {
    let random = &mut Random::new(773);
    let mut gradient = || [1.0, 1e-6, 1e-9, 1e-12].map(|size| (random.normal() + 0.3) as f32 * size);
    let gradients: Vec<[f32; 4]> = (0..1000).map(|_| gradient()).collect();
    // Each moment rounds by 2U of itself a step and decays by a tenth or a thousandth: 20U and √1000 U of it; the
    // parameter by U of itself a step, which is less than the distance moved.
    within(
        "adam",
        "73",
        "course over 1,000 steps, of the way",
        course_error(&gradients),
        1e-5,
    );
}

/// An invisible splat continues by its momentum: Adam is dense here.
#[test]
fn f074_adam_is_dense() {
    let random = &mut Random::new(774);
    let gradients: Vec<[f32; 4]> = (0..300)
        .map(|step| {
            let gradient = [0; 4].map(|_| random.normal() as f32 + 0.5);
            if step % 5 == 0 { gradient } else { [0.0; 4] }
        })
        .collect();
    within(
        "adam",
        "74",
        "course of a splat seen every 5th step",
        course_error(&gradients),
        1e-5,
    );
}

/// Through refinements every row keeps its moments or starts from zero.
#[test]
fn f075_moments_follow_their_splats() {
    for kind in [StrategyKind::Adc, StrategyKind::Mcmc] {
        let config = TrainConfig {
            max_splats: Some(200),
            ..TrainConfig::for_iterations(30_000).with_strategy(kind)
        };
        let scene = scenes::gentle(775, 60, 32, 32, 0);
        let mut state = HostState::from_splats(&scene.splats, 0);
        let random = &mut Random::new(775);
        let mut touched = 0;
        for iteration in 1..=40 {
            for row in 0..state.len() {
                // Row index encoded in the colour and in the moments.
                state.params[3][row][0] = row as f32;
                state.params[0][row][3] = random.between(-6.0, 4.0) as f32;
                state.m[1][row] = [row as f32 + 1.0; 4];
                state.v[0][row] = [row as f32 + 2.0; 4];
            }
            let stats: Vec<SplatStats> = (0..state.len())
                .map(|_| [random.between(0.0, 5e-4) as f32, 1.0, 3.0, 0.0])
                .collect();
            let context = RefineContext {
                iteration: iteration * 100,
                config: &config,
                extent: 4.0,
                limit: config.splat_limit(),
                sky: None,
            };
            let report = strategy::refine(&mut state, &stats, context);
            touched += report.cloned + report.split + report.relocated;
            for row in 0..state.len() {
                let name = state.params[3][row][0];
                let moments = (state.m[1][row], state.v[0][row]);
                let kept = ([name + 1.0; 4], [name + 2.0; 4]);
                assert!(
                    moments == kept || moments == ([0.0; 4], [0.0; 4]),
                    "{kind:?}: {moments:?} of {name}"
                );
            }
        }
        assert!(touched > 50, "{kind:?}: nothing happened");
    }
}

/// A non-finite gradient leaves its four parameters and their moments unchanged, is counted, and has no later effect.
#[test]
fn f076_poisoned_gradient() {
    let lab = lab();
    let random = &mut Random::new(776);
    let gradients: Vec<[f32; 4]> = (0..30).map(|_| [0; 4].map(|_| random.normal() as f32)).collect();
    for poison in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let (mut clean, mut hurt) = (Run::new(&lab, 0, [0.5; 4]), Run::new(&lab, 0, [0.5; 4]));
        let (mut before, mut after) = ([0.5; 4], [0.5; 4]);
        for (step, &gradient) in gradients.iter().enumerate() {
            let mut poisoned = gradient;
            if step == 7 {
                poisoned[2] = poison;
            }
            (before, after) = (clean.step(gradient), hurt.step(poisoned));
            assert_eq!(before == after, step < 7, "step {step}");
        }
        assert_eq!((clean.poisoned(), hurt.poisoned()), (0, 1));
        let apart = (0..4)
            .map(|k| f64::from((before[k] - after[k]).abs()))
            .fold(0.0, f64::max);
        // One step of a thousandth is missing, and its effect on the moments for some ten more.
        within(
            "adam",
            "76",
            &format!("course after a gradient of {poison}"),
            apart,
            20.0 * f64::from(RATE),
        );
    }
}
