//! Training steps with their gradients.

use super::subject::BACKGROUND;
use crate::Result;
use crate::gpu::Gpu;
use crate::lab::bench::input::scene::one_view;
use crate::scene::{Camera, Dataset, Photo, Splats};
use crate::train::state::Planes;
use crate::train::{Background, HostState, TrainConfig, Trainer};

/// Initial iteration: all SH degrees are trained by then, and density control is over.
const BEGUN: u32 = 20_000;

/// Inputs and results of steps.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct StepResult {
    /// Gradient of the last step by every parameter, `[plane][splat]`.
    gradients: Planes,
    /// State of the optimiser after them.
    pub(super) after: HostState,
    /// The loss before the last step.
    pub(super) loss: f64,
    /// Near plane, world units.
    pub(super) near: f64,
    /// Share of D-SSIM in the loss.
    pub(super) lambda: f64,
}

impl StepResult {
    /// A splat's gradient, ordered like `reference::Splat::parameters`.
    pub(super) fn row(&self, splat: usize) -> Vec<f32> {
        let plane = |index: usize| self.gradients[index][splat];
        let [x, y, z, logit] = plane(0);
        let mut row = vec![x, y, z];
        row.extend(plane(1));
        row.extend(&plane(2)[..3]);
        row.push(logit);
        let degree = self.after.sh_degree;
        let count = row.len() + 3 * ((degree + 1) * (degree + 1)) as usize;
        row.extend((3..self.gradients.len()).flat_map(plane));
        row.truncate(count);
        row
    }
}

/// A view with a black photograph: every picture is brighter, so that no pixel's share in the gradient changes its
/// sign. The extent of the data set determines the near plane.
fn dataset(camera: &Camera, near: f64, config: &TrainConfig) -> Dataset {
    let photo = Photo {
        width: camera.width,
        height: camera.height,
        rgba: vec![[0, 0, 0, 255]; camera.width as usize * camera.height as usize],
    };
    one_view(*camera, photo, near / (1.1 * f64::from(config.near_factor)))
}

/// Takes `count` steps.
pub(super) fn steps(gpu: &Gpu, splats: &Splats, camera: &Camera, near: f64, count: u32) -> Result<StepResult> {
    let config = TrainConfig {
        sh_degree: splats.sh_degree,
        ssim_stride: 1,
        filter: splats.filter,
        background: Background::Fixed(BACKGROUND),
        ..TrainConfig::for_iterations(30_000)
    };
    let lambda = f64::from(config.lambda_dssim);
    let dataset = dataset(camera, near, &config);
    let state = HostState::from_splats(splats, splats.sh_degree);
    let mut trainer = Trainer::from_state(gpu, &dataset, config, &state, BEGUN)?;
    trainer.keep_gradients()?;
    let mut reports = Vec::new();
    for _ in 0..count {
        reports.extend(trainer.step()?);
    }
    let gradients = trainer.gradients()?;
    let after = trainer.download()?;
    reports.extend(trainer.finish()?);
    Ok(StepResult {
        gradients,
        after,
        loss: reports.last().map_or(f64::NAN, |report| report.loss),
        near: f64::from(trainer.near()),
        lambda,
    })
}
