//! Whole frames and whole training steps of the built-in scene, stage by stage.

mod common;

use ashfall::bench::{Bench, Case, Unit, Work};
use ashfall::render::{Model, RenderOptions, Renderer, ViewOptions};
use ashfall::scene::RenderMode;
use ashfall::synth::{Kind, SynthOptions, scene};
use ashfall::train::{TrainConfig, Trainer, initial_splats};
use common::Outcome;

/// Splats, and the size of the pictures.
const INPUTS: [(usize, u32, u32); 4] = [
    (5_000, 192, 144),
    (20_000, 480, 270),
    (50_000, 480, 270),
    (50_000, 960, 540),
];

fn main() -> Outcome<()> {
    common::run("frame", frames_and_steps)
}

fn frames_and_steps(bench: &mut Bench) -> Outcome<()> {
    let gpu = bench.gpu().clone();
    for (points, width, height) in INPUTS {
        let cases = ["render", "train"].map(|what| Case {
            input: format!("{what}/{points}/{width}x{height}"),
            work: Work::of(points, Unit::Splats),
            ..Case::default()
        });
        if !cases.iter().any(|case| bench.wants(case)) {
            continue;
        }
        let dataset = scene(Kind::Demo).dataset(&SynthOptions {
            views: 8,
            width,
            height,
            samples: 1,
            points,
            ..SynthOptions::default()
        });
        // Of a long run: no refinement comes in the way, and all is as it is at its beginning.
        let config = TrainConfig::for_iterations(30_000);
        if bench.wants(&cases[0]) {
            let splats = initial_splats(&dataset, dataset.extent(), &config)?;
            let model = Model::upload(&gpu, &splats)?;
            let mut renderer = Renderer::new(&gpu, RenderOptions::default())?;
            let view = ViewOptions {
                background: [0.0; 3],
                near: (dataset.extent() * f64::from(config.near_factor)) as f32,
                mode: RenderMode::Default,
            };
            let camera = dataset.views[0].camera;
            bench.measure(&cases[0], || {
                renderer.render(&model, &camera, &view)?;
                Ok(renderer.timings()?.into())
            })?;
        }
        if bench.wants(&cases[1]) {
            let mut trainer = Trainer::new(&gpu, &dataset, config)?;
            bench.measure(&cases[1], || {
                trainer.step()?;
                Ok(trainer.timings()?.into())
            })?;
        }
    }
    Ok(())
}
