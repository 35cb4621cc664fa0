//! Whole frames and whole training steps of the built-in scene, stage by stage.

mod common;

use ashfall::render::{Model, RenderOptions, Renderer, ViewOptions};
use ashfall::scene::RenderMode;
use ashfall::synth::{Kind, SynthOptions, scene};
use ashfall::train::{TrainConfig, Trainer, initial_splats};
use common::{Bench, Outcome};

/// Splats, and the size of the pictures.
const INPUTS: [(usize, u32, u32); 4] = [
    (5_000, 192, 144),
    (20_000, 480, 270),
    (50_000, 480, 270),
    (50_000, 960, 540),
];

fn main() -> Outcome<()> {
    let mut bench = Bench::new("frame")?;
    for (points, width, height) in INPUTS {
        let names = ["render", "train"].map(|what| format!("{what}/{points}/{width}x{height}"));
        if !names.iter().any(|name| bench.wants(name)) {
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
        if bench.wants(&names[0]) {
            let splats = initial_splats(&dataset, dataset.extent(), &config)?;
            let model = Model::upload(&bench.gpu, &splats)?;
            let mut renderer = Renderer::new(&bench.gpu, RenderOptions::default())?;
            let view = ViewOptions {
                background: [0.0; 3],
                near: (dataset.extent() * f64::from(config.near_factor)) as f32,
                mode: RenderMode::Default,
            };
            let camera = dataset.views[0].camera;
            bench.measure(&names[0], (splats.len(), "splats"), || {
                renderer.render(&model, &camera, &view)?;
                renderer.timings()
            })?;
        }
        if bench.wants(&names[1]) {
            let mut trainer = Trainer::new(&bench.gpu, &dataset, config)?;
            let splats = trainer.splat_count();
            bench.measure(&names[1], (splats, "splats"), || {
                trainer.step()?;
                trainer.timings()
            })?;
        }
    }
    bench.finish()
}
