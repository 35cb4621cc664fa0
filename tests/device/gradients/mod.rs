//! A whole training step on the device (frame, loss, gradients) against the oracle's exact gradient, and properties
//! that need no oracle: relations, determinism, isolation of NaNs, independence of buffer sizes.

mod degrees;
mod geometry;
mod oracle;
mod relations;
mod rounding;
mod training;

use crate::common::scenes::{Scene, photographed};
use ashfall::gpu::Gpu;
use ashfall::scene::{AlphaMode, Camera, Dataset, Point};
use ashfall::train::state::Planes;
use ashfall::train::{Background, HostState, StepReport, TrainConfig, Trainer};

/// First iteration of the runs: all SH bands are trained by then, and density control is over.
const BEGUN: u32 = 20_000;

fn config(scene: &Scene) -> TrainConfig {
    TrainConfig {
        kind: scene.splats.primitive,
        filter: scene.splats.filter,
        sh_degree: scene.splats.sh_degree,
        ssim_stride: 1,
        background: Background::Fixed(scene.options.background.map(|c| c as f32)),
        ..TrainConfig::for_iterations(30_000)
    }
}

/// A data set of one view, with the extent that gives the scene's near plane.
fn dataset(scene: &Scene, camera: &Camera) -> Dataset {
    let distance = scene.options.near / (1.1 * f64::from(config(scene).near_factor));
    let ray = camera.rotation.row(2) * distance;
    let point = Point {
        position: (camera.position + ray).to_array(),
        color: [0.5; 3],
    };
    Dataset {
        views: vec![photographed(*camera, |_| 255)],
        points: vec![point],
        test_every: 0,
        held_out: Vec::new(),
        alpha: AlphaMode::Composite,
        ..Dataset::default()
    }
}

/// Image, gradients, state and report of one step.
#[derive(Clone, Debug, PartialEq)]
struct Stepped {
    image: Vec<f32>,
    gradients: Planes,
    after: HostState,
    report: StepReport,
    near: f32,
}

fn step(gpu: &Gpu, scene: &Scene) -> Stepped {
    step_smoothed(gpu, scene, &[])
}

/// A step with one 3D filter per splat; empty: no filter.
fn step_smoothed(gpu: &Gpu, scene: &Scene, filters: &[f32]) -> Stepped {
    let mut state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
    for (row, &filter) in state.params[2].iter_mut().zip(filters) {
        row[3] = filter;
    }
    step_from(gpu, scene, &state)
}

/// A step from a state of the scene's splats.
fn step_from(gpu: &Gpu, scene: &Scene, state: &HostState) -> Stepped {
    let mut config = config(scene);
    config.adam.color_every = 1;
    step_by(gpu, scene, state, config)
}

/// The same with another configuration.
fn step_by(gpu: &Gpu, scene: &Scene, state: &HostState, config: TrainConfig) -> Stepped {
    let dataset = dataset(scene, &scene.camera);
    let mut trainer = Trainer::from_state(gpu, &dataset, config, state, BEGUN).unwrap();
    trainer.keep_gradients().unwrap();
    trainer.step().unwrap();
    let gradients = trainer.gradients().unwrap();
    let image = trainer.image().unwrap();
    let after = trainer.download().unwrap();
    let report = trainer.finish().unwrap().pop().unwrap();
    Stepped {
        image,
        gradients,
        after,
        report,
        near: trainer.near(),
    }
}
