//! The device as the commands see it: opened by options, drawing pictures, training.
//!
//! All that the commands ask of `gpu`, `render` and the trainer stands here, so that they can be read,
//! and tested, without it.

mod describe;

use super::args::DeviceArgs;
use super::predict::Prediction;
use super::train::{StepFigures, Steps};
use crate::gpu::{DeviceKind, Gpu, GpuOptions, Limits};
use crate::lab::bench::{Bench, BenchRow, Options};
use crate::lab::report::MemoryFigures;
use crate::render::{Compatibility, Model, RenderOptions, Rendered, Renderer, ViewOptions};
use crate::scene::{Camera, Dataset, RenderMode, Splats};
use crate::simplify::{CountController, History};
use crate::train::checkpoint::{Checkpoint, Steering, fingerprint};
use crate::train::{HostState, StepReport, TrainConfig, Trainer};
use crate::{Error, Result};
use std::path::Path;

pub(super) use describe::devices;

/// An opened device.
pub(super) struct Engine {
    gpu: Gpu,
}

impl Engine {
    /// Opens the device that the options ask for.
    pub(crate) fn open(args: &DeviceArgs) -> Result<Engine> {
        let options = GpuOptions {
            device: args.name(),
            validation: args.validate,
            memory_limit: args.memory_limit,
            faults: None,
            limits: Limits {
                binding: args.limit_binding,
                workgroup: args.limit_workgroup,
                without_subgroups: args.without_subgroups,
            },
        };
        let gpu = Gpu::create(&options)?;
        Ok(Engine { gpu })
    }

    /// The device, for measurements, which are made of nothing else.
    pub(crate) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The device's name.
    pub(crate) fn name(&self) -> &str {
        &self.gpu.caps().name
    }

    /// Whether the device is a program on the CPU.
    pub(crate) fn is_software(&self) -> bool {
        self.gpu.caps().kind == DeviceKind::Cpu
    }

    /// Bytes that buffers may take.
    pub(crate) fn memory_limit(&self) -> u64 {
        self.gpu.memory_limit()
    }

    /// Most bytes of device memory held at one time.
    pub(crate) fn memory_peak_bytes(&self) -> u64 {
        self.gpu.memory_peak()
    }

    /// A bench on this device; `progress` sees every row as it is measured.
    pub(crate) fn bench(
        &self,
        name: &'static str,
        options: Options,
        progress: impl FnMut(&BenchRow) + 'static,
    ) -> Result<Bench> {
        Bench::new(name, &self.gpu, options, progress)
    }

    /// What the validation layer has said, if anything, as an error.
    pub(crate) fn check(&self) -> Result<()> {
        self.gpu.wait_idle()?;
        let messages = self.gpu.validation_messages();
        match messages.as_slice() {
            [] => Ok(()),
            [first, ..] => Err(Error::Config(format!(
                "the validation layer has {} messages; the first: {first}",
                messages.len()
            ))),
        }
    }

    /// What the device is and can do, and what was chosen for it: text, and the same for machines.
    pub(crate) fn describe(&self) -> (String, serde_json::Value) {
        describe::chosen(self.gpu.caps(), self.gpu.memory_limit())
    }

    /// Brings a scene to the device to be drawn; nothing nearer than `near` world units is.
    pub(crate) fn scene_renderer(
        &self,
        splats: &Splats,
        near: f64,
        with_depth: bool,
    ) -> Result<SceneRenderer> {
        self.scene_renderer_with(splats, near, with_depth, Compatibility::Engine)
    }

    /// The same by the rules of another method.
    pub(crate) fn scene_renderer_with(
        &self,
        splats: &Splats,
        near: f64,
        with_depth: bool,
        compatibility: Compatibility,
    ) -> Result<SceneRenderer> {
        let options = RenderOptions {
            with_depth,
            compatibility,
            sh_degree: splats.sh_degree,
            ..RenderOptions::default()
        };
        Ok(SceneRenderer {
            renderer: Renderer::new(&self.gpu, options)?,
            model: Model::upload(&self.gpu, splats)?,
            near: near as f32,
            mode: splats.mode,
        })
    }

    /// Begins training.
    pub(crate) fn train<'a>(
        &self,
        dataset: &'a Dataset,
        config: TrainConfig,
    ) -> Result<Training<'a>> {
        Ok(Training {
            trainer: Trainer::new(&self.gpu, dataset, config)?,
            controller: None,
            fingerprint: fingerprint(dataset),
        })
    }

    /// Begins training to no more splats than the scene needs; `preference_db` is the smallest gain worth paying for, in
    /// decibels for a tenth more of them; an open run may end when it has converged.
    pub(crate) fn train_auto<'a>(
        &self,
        dataset: &'a Dataset,
        config: TrainConfig,
        (preference_db, is_open): (f64, bool),
    ) -> Result<Training<'a>> {
        let mut training = self.train(dataset, config)?;
        let controller =
            CountController::begin(&mut training.trainer, dataset, preference_db, is_open)?;
        training.controller = Some(controller);
        Ok(training)
    }

    /// Begins a short training of splats that are there, of which none comes or goes.
    pub(crate) fn refit<'a>(
        &self,
        dataset: &'a Dataset,
        config: TrainConfig,
        splats: &Splats,
    ) -> Result<Training<'a>> {
        let state = HostState::from_splats(splats, splats.sh_degree);
        Ok(Training {
            trainer: Trainer::from_state(&self.gpu, dataset, config, &state, 0)?,
            controller: None,
            fingerprint: fingerprint(dataset),
        })
    }

    /// Goes on training from a checkpoint.
    pub(crate) fn resume<'a>(&self, dataset: &'a Dataset, path: &Path) -> Result<Training<'a>> {
        let saved = Checkpoint::read(path)?;
        saved.check_dataset(path, dataset)?;
        let (state, iteration) = (&saved.state, saved.iteration);
        let mut trainer = Trainer::from_state(&self.gpu, dataset, saved.config, state, iteration)?;
        let controller = match saved.steering {
            None => None,
            Some(Steering { notes, kept }) => {
                let history = serde_json::from_value(notes)
                    .map_err(|e| Error::file(path, format!("its notes cannot be read: {e}")))?;
                Some(CountController::resume(
                    &mut trainer,
                    dataset,
                    history,
                    kept,
                )?)
            }
        };
        trainer.set_statistics(&saved.statistics)?;
        Ok(Training {
            trainer,
            controller,
            fingerprint: saved.fingerprint,
        })
    }
}

/// A rendering, `[row][column]`.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    /// Display-referred, over the background.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage, 0 to 1.
    pub alpha: Vec<f32>,
    /// Mean along the view's z axis in world units, infinite where nothing is; empty unless asked for.
    pub depth: Vec<f32>,
}

/// Coverage below which there is nothing to have a depth: one level of 8 bits.
const COVERAGE_MIN: f32 = 1.0 / 255.0;

impl From<Rendered> for Picture {
    fn from(rendered: Rendered) -> Picture {
        let alpha: Vec<f32> = rendered.transmittance.iter().map(|t| 1.0 - t).collect();
        let mean = |(sum, &alpha): (&f32, &f32)| match alpha >= COVERAGE_MIN {
            true => sum / alpha,
            false => f32::INFINITY,
        };
        Picture {
            width: rendered.width,
            height: rendered.height,
            rgb: rendered.rgb,
            depth: rendered.depth.iter().zip(&alpha).map(mean).collect(),
            alpha,
        }
    }
}

/// A scene on the device, ready to be drawn.
pub(super) struct SceneRenderer {
    renderer: Renderer,
    model: Model,
    near: f32,
    mode: RenderMode,
}

impl SceneRenderer {
    /// Draws a view.
    pub(crate) fn draw(&mut self, camera: &Camera, background: [f32; 3]) -> Result<Picture> {
        let view = ViewOptions {
            background,
            near: self.near,
            mode: self.mode,
        };
        let rendered = self.renderer.render(&self.model, camera, &view)?;
        Ok(Picture::from(rendered))
    }
}

/// A training run on the device.
pub(super) struct Training<'a> {
    trainer: Trainer<'a>,
    /// What steers it, if anything does.
    controller: Option<CountController<'a>>,
    fingerprint: u32,
}

impl Training<'_> {
    /// The run's constants.
    pub(crate) fn config(&self) -> &TrainConfig {
        self.trainer.config()
    }

    /// What has been found of the splats that the scene needs, where that is looked for.
    pub(crate) fn history(&self) -> Option<&History> {
        self.controller.as_ref().map(CountController::history)
    }

    /// What the run will take of the device's memory: how many splats it will have, if that can be known, or
    /// how many it begins with.
    pub(crate) fn prediction(&self) -> Prediction {
        let size = self.trainer.size();
        Prediction::of(size, self.trainer.splats_expected())
    }

    /// What it has taken so far.
    pub(crate) fn memory(&self) -> MemoryFigures {
        let (gpu, size) = (self.trainer.gpu(), self.trainer.size());
        let buffers = gpu.memory_by_name().into_iter();
        MemoryFigures {
            peak_bytes: gpu.memory_peak(),
            reserved_peak_bytes: gpu.memory_reserved_peak(),
            predicted_bytes: size.bytes(),
            essential_bytes: size.essential_bytes(),
            splats_peak: size.splats,
            isects_peak: size.isects,
            buffers: buffers
                .filter(|(_, memory)| memory.peak_bytes > 0)
                .map(|(name, memory)| (name, memory.peak_bytes))
                .collect(),
        }
    }
}

impl Steps for Training<'_> {
    fn iteration(&self) -> u32 {
        self.trainer.iteration()
    }

    fn step(&mut self) -> Result<Vec<StepFigures>> {
        let report = self.trainer.step()?;
        if let Some(controller) = &mut self.controller {
            controller.after_step(&mut self.trainer)?;
        }
        Ok(report.into_iter().map(figures).collect())
    }

    fn finish(&mut self) -> Result<Vec<StepFigures>> {
        Ok(self.trainer.finish()?.into_iter().map(figures).collect())
    }

    fn splats(&mut self) -> Result<Splats> {
        self.trainer.splats()
    }

    fn end(&self) -> Option<u32> {
        self.history().map(|history| history.end)
    }

    fn checkpoint(&mut self, path: &Path) -> Result<()> {
        let state = self.trainer.download()?;
        let checkpoint = Checkpoint {
            config: self.trainer.config().clone(),
            iteration: self.trainer.iteration(),
            state,
            statistics: self.trainer.statistics()?,
            fingerprint: self.fingerprint,
            steering: self.controller.as_ref().map(|controller| Steering {
                notes: serde_json::to_value(controller.history()).unwrap_or_default(),
                kept: controller.kept().cloned(),
            }),
        };
        checkpoint.write(path)
    }
}

fn figures(report: StepReport) -> StepFigures {
    StepFigures {
        iteration: report.iteration,
        loss: report.loss,
        psnr_db: report.psnr_db,
        splat_count: report.splat_count,
        poisoned: report.poisoned_first,
    }
}
