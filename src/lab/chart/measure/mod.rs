//! Measurements of the chart: every setting of every knob, timed and compared with the reference.
//!
//! Frames are compared with the `f64` reference without cuts, pixel by pixel, each pixel with its own proven bound
//! ([`crate::reference::bound`]); gradients likewise, parameter by parameter; training runs by held-out views, over
//! several seeds, and their geometry against that of a made scene.

mod frames;
mod geometry;
mod gradients;
mod scenes;
mod settings;
mod training;

use super::Chart;
use crate::gpu::Gpu;
use crate::scene::{Camera, Dataset, Splats, Split};
use crate::train::TrainConfig;
use crate::{Error, Result};

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
    /// Measure the geometry of trained scenes.
    pub with_geometry: bool,
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
        with_geometry: true,
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

/// Device, photographs and scene of the compared frames and steps.
#[derive(Clone, Copy)]
struct SceneInputs<'a> {
    gpu: &'a Gpu,
    dataset: &'a Dataset,
    splats: &'a Splats,
    plan: &'a ChartPlan,
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
    if plan.with_geometry {
        chart.geometry = geometry::measure(gpu, plan, progress)?;
    }
    if !plan.with_accuracy {
        return Ok(chart);
    }
    let made = match (scene, trained) {
        (Some(scene), _) => scene.clone(),
        (None, Some(trained)) => trained,
        (None, None) => {
            progress("training a scene to draw");
            let (_, config) = settings::default_run(plan, dataset);
            training::splats(gpu, dataset, config)?
        }
    };
    let inputs = SceneInputs {
        gpu,
        dataset,
        splats: &made,
        plan,
    };
    (chart.frames, chart.projection) = inputs.frames(progress)?;
    chart.gradients = inputs.gradients(progress)?;
    Ok(chart)
}

/// A view reduced to at most `pixels`.
fn reduced(camera: &Camera, pixels: usize) -> Camera {
    let count = f64::from(camera.width) * f64::from(camera.height);
    let factor = (pixels as f64 / count).sqrt().min(1.0);
    let side = |length: u32| ((f64::from(length) * factor).floor() as u32).max(2);
    camera.resized(side(camera.width), side(camera.height))
}

impl SceneInputs<'_> {
    /// Reduced cameras of some of the held-out views, else of all, spread evenly.
    fn cameras(&self) -> Result<Vec<Camera>> {
        let mut cameras = self.cameras_of(Split::Test);
        if cameras.is_empty() {
            cameras = self.cameras_of(Split::All);
        }
        if cameras.is_empty() {
            return Err(Error::Config("the data set has no view".into()));
        }
        let count = self.plan.views.clamp(1, cameras.len());
        Ok((0..count).map(|i| cameras[i * cameras.len() / count]).collect())
    }

    /// Reduced cameras of a split.
    fn cameras_of(&self, split: Split) -> Vec<Camera> {
        let cameras = self
            .dataset
            .split(split)
            .into_iter()
            .map(|view| &self.dataset.views[view].camera);
        cameras.map(|camera| reduced(camera, self.plan.frame_pixels)).collect()
    }

    /// Near plane, world units.
    fn near(&self) -> f32 {
        TrainConfig::default().near(self.dataset.extent())
    }
}
