//! Training steps, submitted without waiting for the device except where sizes change.
//!
//! A step with more intersections than the buffers hold does nothing, nor do the steps behind it; when its report
//! arrives, the buffers grow and training repeats that step. So results do not depend on buffer sizes, and a resumed
//! run equals an uninterrupted one to the bit.

mod capacity;
mod coarse;
mod inspect;
mod poses;
mod steer;
mod submit;
mod transients;

use super::backward::Backward;
use super::colors::ColorQueue;
use super::config::{ExposureModel, TrainConfig};
use super::device::DeviceState;
use super::exposure::ExposureGains;
use super::gradients::Gradients;
use super::memory::{BufferLimits, IN_FLIGHT};
use super::photos::Photos;
use super::poses::{PoseState, RefinedPoses};
use super::reorder::RefinedRows;
use super::sky::SkyShell;
use super::state::HostState;
use super::strategy::{self, RefineContext, RefineReport, RowOrigin};
use super::transients::{IgnoredPatches, TransientState};
use super::{initial_splats, schedule, smoothing};
use crate::gpu::{Frames, Gpu};
use crate::kernels::select_rows::{Choice, SelectRows};
use crate::render::{Capacity, DepthBands, Forward, Scratch};
use crate::scene::{Camera, Dataset, ScreenFilter, Splats, Split, mean_up};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::VecDeque;

pub use capacity::Extremes;
use capacity::{limit_splats, new_scratch};
use coarse::Coarse;
use submit::StepInFlight;

/// Report of a finished step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepReport {
    /// Iteration, from 1.
    pub iteration: u32,
    /// (1 − λ) L1 + λ (1 − SSIM) before the step's update.
    pub loss: f64,
    /// PSNR of the rendering before the step's update, decibels.
    pub psnr_db: f64,
    /// Number of splats trained.
    pub splat_count: usize,
    /// Splats that touch a tile of the frame.
    pub visible_count: usize,
    /// (Splat, tile) pairs of the frame.
    pub isect_count: usize,
    /// Groups of four parameters left unchanged because their gradient was not finite.
    pub poisoned: usize,
    /// First splat with such a group, in the device's order: lower degrees first.
    pub poisoned_first: Option<usize>,
    /// Report of the refinement after the step, if there was one.
    pub refined: Option<RefineReport>,
}

/// States of the photographs in a run, beside the splats.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotoStates {
    /// Exposures, if the run has them.
    pub exposure: Option<ExposureGains>,
    /// Poses, if the run refines them.
    pub poses: Option<PoseState>,
    /// Patches that are left out, if the run ignores transients.
    pub transients: Option<TransientState>,
}

/// Fits splats to the training views of a data set.
pub struct Trainer<'a> {
    gpu: Gpu,
    dataset: &'a Dataset,
    views: Vec<usize>,
    config: TrainConfig,
    extent: f64,
    /// Splat limit.
    limit: usize,
    forward: Forward,
    backward: Backward,
    select_rows: SelectRows,
    state: DeviceState,
    scratch: Scratch,
    /// Depth bands of the next steps.
    bands: DepthBands,
    gradients: Gradients,
    /// Steps whose gradients of colours wait.
    colors: ColorQueue,
    /// Photographs of `coarse` if present, else of `dataset`.
    photos: Photos,
    /// The training views at reduced size, while steps use those.
    coarse: Option<Coarse>,
    /// Exposures of the photographs, in the order of `views`.
    exposure: Option<ExposureGains>,
    /// Refined poses of the photographs, in the order of `views`.
    poses: Option<RefinedPoses>,
    /// Patches of the photographs that are left out, in the order of `views`.
    transients: Option<IgnoredPatches>,
    frames: Frames,
    /// Last iteration recorded.
    iteration: u32,
    pending: VecDeque<StepInFlight>,
    done: VecDeque<StepReport>,
    extremes: Extremes,
}

/// Kernels of the frame, and those of a step after it.
fn compile(gpu: &Gpu, config: &TrainConfig) -> Result<(Forward, Backward)> {
    gpu.compile_both(
        || Forward::for_training(gpu, config.sh_degree, &config.accuracy, config.plain_outputs()),
        || Backward::new(gpu, config),
    )
}

impl<'a> Trainer<'a> {
    /// Starts a run from the data set's points, or from random ones if it has none.
    pub fn new(gpu: &Gpu, dataset: &'a Dataset, mut config: TrainConfig) -> Result<Trainer<'a>> {
        limit_splats(gpu, &mut config);
        let splats = initial_splats(dataset, dataset.extent(), &config)?;
        let mut state = HostState::from_splats(&splats, config.sh_degree);
        smooth(&mut state, dataset, &config);
        Trainer::from_state(gpu, dataset, config, &state, 0)
    }

    /// Continues from the state after `iteration`. Statistics of density control start at 0, no gradient of a colour
    /// waits, and exposures, if the run has them, start as those of a new run.
    pub fn from_state(
        gpu: &Gpu,
        dataset: &'a Dataset,
        config: TrainConfig,
        state: &HostState,
        iteration: u32,
    ) -> Result<Trainer<'a>> {
        Trainer::continued(gpu, dataset, config, state, iteration, PhotoStates::default())
    }

    /// [`Trainer::from_state`] with exposures and poses of an earlier part of the run.
    pub fn continued(
        gpu: &Gpu,
        dataset: &'a Dataset,
        mut config: TrainConfig,
        state: &HostState,
        iteration: u32,
        photos: PhotoStates,
    ) -> Result<Trainer<'a>> {
        config.validate()?;
        if state.primitive != config.kind {
            let (found, wanted) = (state.primitive.name(), config.kind.name());
            let text = format!("the first splats are of the kind {found}, but the run trains {wanted}: set the kind");
            return Err(Error::Config(text));
        }
        limit_splats(gpu, &mut config);
        let views = dataset.split(Split::Train);
        if views.is_empty() {
            return Err(Error::Config("the data set has no training view".into()));
        }
        let exposure = match (config.exposure, photos.exposure) {
            (ExposureModel::Off, _) => None,
            (ExposureModel::Gain, Some(given)) => Some(given),
            (ExposureModel::Gain, None) => Some(ExposureGains::begin(dataset, &views)?),
        };
        let extent = dataset.extent();
        let poses = poses::begin(dataset, &views, extent, &config, photos.poses)?;
        let transients = transients::begin(dataset, &config, photos.transients)?;
        let cameras = views.iter().map(|&view| &dataset.views[view].camera);
        let binding = BufferLimits::of(gpu).step_binding(&config);
        let capacity = cameras
            .map(|camera| capacity::before_steps(state.len(), camera, config.outputs(), binding))
            .fold(Capacity::LEAST, Capacity::max);
        let scratch = new_scratch(gpu, capacity, DepthBands::default(), config.outputs())?;
        let mut extremes = Extremes::default();
        extremes.note(&state.degrees);
        let halvings = schedule::halvings(&config, iteration);
        let (coarse, photos) = coarse::begin(gpu, dataset, &views, &config, halvings)?;
        let (forward, backward) = compile(gpu, &config)?;
        let mut trainer = Trainer {
            gpu: gpu.clone(),
            dataset,
            extent,
            limit: config.splat_limit(),
            forward,
            backward,
            select_rows: SelectRows::new(gpu, Choice::default())?,
            state: DeviceState::new(gpu, state, config.filter)?,
            gradients: Gradients::new(gpu, scratch.capacity, config.outputs())?,
            scratch,
            bands: DepthBands::default(),
            colors: ColorQueue::new(iteration, &[]),
            photos,
            coarse,
            exposure,
            poses,
            transients,
            frames: Frames::new(gpu, IN_FLIGHT, true)?,
            views,
            config,
            iteration,
            pending: VecDeque::new(),
            done: VecDeque::new(),
            extremes,
        };
        trainer.prepare()?;
        Ok(trainer)
    }

    /// Last iteration begun.
    pub fn iteration(&self) -> u32 {
        self.iteration
    }

    /// Whether all iterations have begun; the last reports come from [`Trainer::finish`].
    pub fn is_done(&self) -> bool {
        self.iteration >= self.config.iterations
    }

    /// Device of the run.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Constants of the run.
    pub fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Scene extent in world units.
    pub fn extent(&self) -> f64 {
        self.extent
    }

    /// Current number of splats.
    pub fn splat_count(&self) -> usize {
        self.state.model.splat_count
    }

    /// Exposures after the last step begun; `None` if the run has none. Waits for it.
    pub fn exposure(&mut self) -> Result<Option<ExposureGains>> {
        self.settle()?;
        Ok(self.exposure.clone())
    }

    /// Near plane of the cameras, world units.
    pub fn near(&self) -> f32 {
        self.config.near(self.extent)
    }

    /// Begins the next iteration; returns the report of an earlier one, if one has finished.
    ///
    /// # Errors
    /// [`Error::Step`] names the iteration. The device's state may then lie within a step: resume from a checkpoint.
    pub fn step(&mut self) -> Result<Option<StepReport>> {
        let iteration = self.iteration + 1;
        self.advance().map_err(|e| e.at_step(iteration))
    }

    fn advance(&mut self) -> Result<Option<StepReport>> {
        if self.pending.len() == IN_FLIGHT {
            self.collect()?;
        }
        self.enlarge()?;
        let iteration = self.iteration + 1;
        let pending = self.submit(iteration)?;
        self.pending.push_back(pending);
        self.iteration = iteration;
        let (refine, reset) = (
            schedule::is_refine(&self.config, iteration),
            schedule::is_reset(&self.config, iteration),
        );
        let expose = schedule::is_exposure(&self.config, self.views.len(), iteration);
        let is_epoch = self.transients.is_some() && (iteration as usize).is_multiple_of(self.views.len());
        let poses = schedule::is_pose_round(&self.config, iteration);
        // A step that did not fit is repeated first: only its result is refined.
        if (refine || reset || expose || poses || is_epoch) && self.drain()? {
            if let Some(exposure) = self.exposure.as_mut().filter(|_| expose) {
                exposure.update();
            }
            if is_epoch {
                self.update_transients(iteration);
            }
            if poses {
                self.adjust_poses()?;
            }
            if refine || reset {
                self.refine(iteration, refine, reset)?;
            }
        }
        Ok(self.done.pop_front())
    }

    /// Waits for all steps begun and returns their reports. Steps that did not fit are repeated.
    pub fn finish(&mut self) -> Result<Vec<StepReport>> {
        let iteration = self.iteration;
        self.catch_up().map_err(|e| e.at_step(iteration))
    }

    fn catch_up(&mut self) -> Result<Vec<StepReport>> {
        let wanted = self.iteration;
        let mut reports = Vec::new();
        loop {
            self.drain()?;
            reports.extend(self.done.drain(..));
            if self.iteration >= wanted {
                return Ok(reports);
            }
            reports.extend(self.step()?);
        }
    }

    /// Labels and nanoseconds of the last step begun; waits for it.
    pub fn timings(&self) -> Result<Vec<(&'static str, f64)>> {
        self.pending
            .back()
            .map_or(Ok(Vec::new()), |last| self.frames.timings(last.ticket))
    }

    /// Parameters and moments after the last step begun; waits for it.
    pub fn download(&mut self) -> Result<HostState> {
        self.settle()?;
        let state = self.state.download(&self.gpu);
        state.map_err(|e| e.at_step(self.iteration))
    }

    /// The splats after the last step begun; waits for it.
    pub fn splats(&mut self) -> Result<Splats> {
        Ok(Splats {
            origin: self.dataset.origin,
            up: self.up(),
            ..self.download()?.to_splats(self.config.filter)
        })
    }

    /// Mean upward direction of the training cameras.
    fn up(&self) -> Option<DVec3> {
        let cameras = self.views.iter().map(|&view| self.dataset.views[view].camera);
        mean_up(&cameras.collect::<Vec<Camera>>())
    }

    /// Waits for all steps in flight. False: one did not fit, and training has returned to the iteration before it.
    fn drain(&mut self) -> Result<bool> {
        while !self.pending.is_empty() {
            if !self.collect()? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn refine(&mut self, iteration: u32, refine: bool, reset: bool) -> Result<()> {
        let mut geometry = self.state.download_geometry(&self.gpu)?;
        let unmoved = |row| RowOrigin { row, is_new: false };
        let mut origins: Vec<RowOrigin> = (0..geometry.len() as u32).map(unmoved).collect();
        if refine {
            let statistics = self.state.download_statistics(&self.gpu)?;
            let context = RefineContext {
                iteration,
                config: &self.config,
                extent: self.extent,
                limit: self.limit,
                sky: self.sky(),
            };
            let report;
            (report, origins) = strategy::refine_rows(&mut geometry, &statistics, context);
            if let Some(last) = self.done.back_mut() {
                last.refined = Some(report);
            }
        }
        smooth(&mut geometry, self.dataset, &self.config);
        if reset {
            strategy::reset_opacity(&mut geometry, self.config.adc.opacity_reset_value, self.sky());
        }
        self.take_rows(&RefinedRows {
            geometry: &geometry,
            origins: &origins,
            resets_opacity: reset,
        })
    }
}

impl Trainer<'_> {
    /// Shell of the sky, if the run has one.
    fn sky(&self) -> Option<SkyShell> {
        let shell = || SkyShell::around(self.dataset, self.extent, &self.config.shell);
        self.config.sky.then(shell)
    }
}

/// Updates the smoothing filter, if the screen filter has one, to the splats' positions.
fn smooth(state: &mut HostState, dataset: &Dataset, config: &TrainConfig) {
    if config.filter == ScreenFilter::Mip && config.mip.smoothing > 0.0 {
        let views = dataset.split(Split::Train).into_iter();
        let cameras: Vec<_> = views.map(|view| dataset.views[view].camera).collect();
        let near = dataset.extent() * f64::from(config.near_factor);
        smoothing::refresh(state, &cameras, near, &config.mip);
    }
}
