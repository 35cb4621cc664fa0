//! Measurements of the chart: every setting of every knob, timed and compared with the reference.
//!
//! Frames are compared with the `f64` reference without cuts, pixel by pixel, each pixel with its own proven bound
//! ([`crate::reference::bound`]); gradients likewise, parameter by parameter; training runs by held-out views, over
//! several seeds.

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

use gradients::GradientInputs;
use scenes::FrameInputs;

/// Sizes and repetitions of the measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartPlan {
    /// Most pixels of a compared frame: the reference takes every pixel through all splats.
    pub frame_pixels: usize,
    /// Most pixels of a view that are also drawn along rays, through all splats.
    pub ray_pixels: usize,
    /// Most pixels of a compared training step, the slowest reference.
    pub gradient_pixels: usize,
    /// Views of compared frames.
    pub views: usize,
    /// Repetitions of every timed frame and step.
    pub runs: usize,
    /// Training runs of each setting.
    pub seeds: u64,
    /// Steps of such a run.
    pub iterations: u32,
    /// Few settings of each knob.
    pub is_quick: bool,
    /// Measure frames and gradients.
    pub with_accuracy: bool,
    /// Measure training runs.
    pub with_training: bool,
}

impl ChartPlan {
    /// A few minutes on a software device.
    pub const USUAL: ChartPlan = ChartPlan {
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

    /// A few seconds, for tests.
    pub const QUICK: ChartPlan = ChartPlan {
        frame_pixels: 1_500,
        ray_pixels: 300,
        gradient_pixels: 600,
        views: 1,
        runs: 2,
        seeds: 2,
        iterations: 20,
        is_quick: true,
        ..ChartPlan::USUAL
    };
}

/// Measures the plan's points and reports progress in words. Without a `scene`, frames and gradients are those of the
/// first training run with default options.
///
/// # Errors
/// When the data set has no view to train on or to hold out, and those of the device.
pub fn measure(
    gpu: &Gpu,
    dataset: &Dataset,
    scene: Option<&Splats>,
    plan: &ChartPlan,
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
    let camera = |view: usize| reduced(&dataset.views[view].camera, plan.frame_pixels);
    let cameras: Vec<Camera> = views(dataset, plan)?.into_iter().map(camera).collect();
    let pruned_by: Vec<Camera> = dataset.split(Split::Train).into_iter().map(camera).collect();
    let frames = FrameInputs {
        splats: &made,
        cameras: &cameras,
        pruned_by: &pruned_by,
        near: TrainConfig::default().near(dataset.extent()),
    };
    (chart.frames, chart.projection) = frames.measure(gpu, plan, progress)?;
    let gradients = GradientInputs {
        gpu,
        dataset,
        splats: &made,
    };
    chart.gradients = gradients.measure(plan, progress)?;
    Ok(chart)
}

/// A view reduced to at most `pixels`.
fn reduced(camera: &Camera, pixels: usize) -> Camera {
    let count = f64::from(camera.width) * f64::from(camera.height);
    let factor = (pixels as f64 / count).sqrt().min(1.0);
    let side = |length: u32| ((f64::from(length) * factor).floor() as u32).max(2);
    camera.resized(side(camera.width), side(camera.height))
}

/// Some of the held-out views, else of all, spread evenly.
fn views(dataset: &Dataset, plan: &ChartPlan) -> Result<Vec<usize>> {
    let mut views = dataset.split(Split::Test);
    if views.is_empty() {
        views = dataset.split(Split::All);
    }
    if views.is_empty() {
        return Err(Error::Config("the data set has no view".into()));
    }
    let count = plan.views.clamp(1, views.len());
    Ok((0..count).map(|i| views[i * views.len() / count]).collect())
}
