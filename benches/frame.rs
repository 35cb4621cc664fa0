//! Whole frames by number of splats and size of the picture, and whole training steps of the built-in scene, stage by
//! stage: a subset of `ashfall bench frame` and `ashfall bench train`.

mod common;

use ashfall::lab::bench::Bench;
use ashfall::lab::bench::frame::{self, FramePlan};
use ashfall::lab::bench::train::{self, TrainPlan};
use ashfall::lab::synth::{Kind, SynthOptions, scene};
use ashfall::scene::Primitive;
use common::Outcome;

fn main() -> Outcome<()> {
    common::run("frame", frames_and_steps)
}

fn frames_and_steps(bench: &mut Bench) -> Outcome<()> {
    let plan = FramePlan {
        splats: vec![20_000, 50_000, 200_000],
        sizes: vec![[480, 270], [1920, 1080]],
        sh_degree: 3,
        scene: None,
    };
    let scaling = frame::run(bench, &plan)?;
    scaling
        .exponents
        .iter()
        .for_each(|exponent| println!("{}", exponent.line()));
    let dataset = scene(Kind::Demo).dataset(&SynthOptions {
        views: 8,
        width: 480,
        height: 270,
        samples: 1,
        points: 10_000,
        ..SynthOptions::default()
    });
    let plan = TrainPlan {
        splats: train::SPLATS.to_vec(),
        steps: 100,
        warm_up: 20,
        sh_degree: 3,
        kind: Primitive::Gaussian3d,
        scene: None,
        budgets: Vec::new(),
    };
    train::run(bench, &dataset, &plan)?;
    Ok(())
}
