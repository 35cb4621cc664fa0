//! The measurements of the chart of speed against accuracy: every setting of every knob, timed and judged.
//!
//! Frames are judged against the `f64` reference that saves nothing, pixel by pixel, each pixel by its own
//! proven bound ([`crate::reference::bound`]); gradients likewise, parameter by parameter; training runs by views
//! that were held out, over several seeds. The page itself is [`crate::lab::chart`].

mod frames;
mod gradients;
mod scenes;
mod settings;
mod training;

use super::Chart;
use crate::gpu::Gpu;
use crate::scene::{Camera, Dataset, Splats, Split};
use crate::train::TrainConfig;
use crate::{Error, Result};

pub use frames::{Frames, judge};
use gradients::Gradients;

/// How much is measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Pixels of a judged frame at most: the reference takes every pixel through all splats.
    pub frame_pixels: usize,
    /// Pixels of a view at most that are also seen along rays, where every splat counts for every pixel.
    pub ray_pixels: usize,
    /// Pixels of a judged training step at most: its reference is slower still.
    pub gradient_pixels: usize,
    /// Views that frames are judged in.
    pub views: usize,
    /// Times that every frame and step is timed.
    pub runs: usize,
    /// Runs of training for each setting.
    pub seeds: u64,
    /// Steps of such a run.
    pub iterations: u32,
    /// Whether knobs have few settings.
    pub is_quick: bool,
    /// Whether frames and gradients are charted.
    pub with_accuracy: bool,
    /// Whether training runs are.
    pub with_training: bool,
}

impl Plan {
    /// A few minutes on a software device.
    pub const USUAL: Plan = Plan {
        frame_pixels: 40_000,
        ray_pixels: 4_000,
        gradient_pixels: 8_000,
        views: 2,
        runs: 15,
        seeds: 3,
        iterations: 300,
        is_quick: false,
        with_accuracy: true,
        with_training: true,
    };

    /// A few seconds: whether all works, not what comes out.
    pub const QUICK: Plan = Plan {
        frame_pixels: 1_500,
        ray_pixels: 300,
        gradient_pixels: 600,
        views: 1,
        runs: 2,
        seeds: 2,
        iterations: 20,
        is_quick: true,
        ..Plan::USUAL
    };
}

/// Measures everything that the plan asks for, and says what it is at. Without a `scene`, frames and gradients
/// are those of the first training run with default options.
///
/// # Errors
/// When the data set has no view to train on or to hold out, and those of the device.
pub fn measure(
    gpu: &Gpu,
    dataset: &Dataset,
    scene: Option<&Splats>,
    plan: &Plan,
    progress: &mut dyn FnMut(&str),
) -> Result<Chart> {
    let mut chart = Chart::default();
    let mut trained = None;
    if plan.with_training {
        let (runs, splats) = training::measure(gpu, dataset, plan, progress)?;
        (chart.runs, trained) = (runs, Some(splats));
    }
    if !plan.with_accuracy {
        return Ok(chart);
    }
    let made = match (scene, trained) {
        (Some(scene), _) => scene.clone(),
        (None, Some(trained)) => trained,
        (None, None) => {
            progress("training a scene to draw");
            training::splats(gpu, dataset, TrainConfig::for_iterations(plan.iterations))?
        }
    };
    let cameras = cameras(dataset, plan)?;
    let near = TrainConfig::default().near(dataset.extent());
    let pruned_by = training_cameras(dataset, plan);
    let frames = Frames {
        splats: &made,
        cameras: &cameras,
        pruned_by: &pruned_by,
        near,
    };
    (chart.frames, chart.projection) = frames.measure(gpu, plan, progress)?;
    let gradients = Gradients {
        gpu,
        dataset,
        splats: &made,
    };
    chart.gradients = gradients.measure(plan, progress)?;
    Ok(chart)
}

/// A view reduced to so many pixels at most.
fn reduced(camera: &Camera, pixels: usize) -> Camera {
    let count = f64::from(camera.width) * f64::from(camera.height);
    let factor = (pixels as f64 / count).sqrt().min(1.0);
    let side = |length: u32| ((f64::from(length) * factor).floor() as u32).max(2);
    camera.resized(side(camera.width), side(camera.height))
}

/// The training views, of the size that frames are judged in.
fn training_cameras(dataset: &Dataset, plan: &Plan) -> Vec<Camera> {
    let views = dataset.split(Split::Train).into_iter();
    views
        .map(|view| reduced(&dataset.views[view].camera, plan.frame_pixels))
        .collect()
}

/// Some of the held-out views, else of all, spread evenly.
fn cameras(dataset: &Dataset, plan: &Plan) -> Result<Vec<Camera>> {
    let test = dataset.split(Split::Test);
    let views = if test.is_empty() {
        dataset.split(Split::All)
    } else {
        test
    };
    if views.is_empty() {
        return Err(Error::Config("the data set has no view".into()));
    }
    let count = plan.views.clamp(1, views.len());
    let chosen = (0..count).map(|i| views[i * views.len() / count]);
    Ok(chosen
        .map(|view| reduced(&dataset.views[view].camera, plan.frame_pixels))
        .collect())
}
