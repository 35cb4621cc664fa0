//! Training run: a trainer with an optional controller, from the first step to the checkpoint on disk.

use super::checkpoint::{Checkpoint, ControllerState, fingerprint};
use super::exposure::ExposureGains;
use super::poses::RefinedPoses;
use super::transients::IgnoredPatches;
use super::{HostState, PhotoStates, StepReport, TrainConfig, Trainer};
use crate::gpu::Gpu;
use crate::scene::{Dataset, Splats};
use crate::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;

/// Decisions between the steps of a run: its views, number of splats and end.
pub trait Controller<'a>: Sized {
    /// Name of the controller in checkpoints.
    const NAME: &'static str;
    /// Version of [`Controller::State`]; checkpoints of other versions are refused.
    const VERSION: u32;
    /// State that decisions depend on, beside the trainer's.
    type State: Serialize + DeserializeOwned;

    /// Controller of a resumed run; `kept` is the second scene state that [`Controller::kept`] gave.
    fn resume(
        trainer: &mut Trainer<'a>,
        dataset: &'a Dataset,
        state: Self::State,
        kept: Option<HostState>,
    ) -> Result<Self>;

    /// Decides and acts after the trainer's last step.
    fn after_step(&mut self, trainer: &mut Trainer<'a>) -> Result<()>;

    /// Iteration at which the run ends, as far as known.
    fn end(&self) -> u32;

    /// State for a checkpoint.
    fn state(&self) -> &Self::State;

    /// Second scene state that the run may go back to.
    fn kept(&self) -> Option<&HostState>;
}

/// Training run on a device, with a controller or without.
///
/// The same data set, configuration, controller and device give the same bytes, whether the run was saved and resumed
/// or not.
pub struct Run<'a, C> {
    trainer: Trainer<'a>,
    dataset: &'a Dataset,
    controller: Option<C>,
}

impl<'a, C: Controller<'a>> Run<'a, C> {
    /// Run from the data set's points, or from random ones if it has none.
    pub fn new(gpu: &Gpu, dataset: &'a Dataset, config: TrainConfig) -> Result<Run<'a, C>> {
        Ok(Run {
            trainer: Trainer::new(gpu, dataset, config)?,
            dataset,
            controller: None,
        })
    }

    /// Run from given splats, at their SH degree.
    pub fn from_splats(gpu: &Gpu, dataset: &'a Dataset, config: TrainConfig, splats: &Splats) -> Result<Run<'a, C>> {
        let state = HostState::from_splats(splats, splats.sh_degree);
        Ok(Run {
            trainer: Trainer::from_state(gpu, dataset, config, &state, 0)?,
            dataset,
            controller: None,
        })
    }

    /// Puts the run under a controller before its first step.
    pub fn controlled(mut self, begin: impl FnOnce(&mut Trainer<'a>, &'a Dataset) -> Result<C>) -> Result<Run<'a, C>> {
        self.controller = Some(begin(&mut self.trainer, self.dataset)?);
        Ok(self)
    }

    /// Run as [`Run::save`] left it.
    ///
    /// # Errors
    /// A file that cannot be read, another data set than the run was begun with, or the state of another controller.
    pub fn resume(gpu: &Gpu, dataset: &'a Dataset, path: &Path) -> Result<Run<'a, C>> {
        let saved = Checkpoint::read(path)?;
        saved.check_dataset(path, dataset)?;
        let (state, iteration) = (&saved.state, saved.iteration);
        let photos = PhotoStates {
            exposure: saved.exposure,
            poses: saved.poses,
            transients: saved.transients,
        };
        let mut trainer = Trainer::continued(gpu, dataset, saved.config, state, iteration, photos)?;
        let controller = match saved.controller {
            None => None,
            Some(saved) => {
                let state = typed::<C>(path, &saved)?;
                Some(C::resume(&mut trainer, dataset, state, saved.kept)?)
            }
        };
        trainer.set_statistics(&saved.statistics)?;
        trainer.set_pending_colors(&saved.colors)?;
        Ok(Run {
            trainer,
            dataset,
            controller,
        })
    }

    /// Writes the checkpoint for [`Run::resume`] atomically.
    pub fn save(&mut self, path: &Path) -> Result<()> {
        let controller = self.controller.as_ref().map(|controller| {
            let state = serde_json::to_value(controller.state());
            Ok(ControllerState {
                name: C::NAME.into(),
                version: C::VERSION,
                state: state.map_err(|e| Error::file(path, e.to_string()))?,
                kept: controller.kept().cloned(),
            })
        });
        let checkpoint = Checkpoint {
            config: self.trainer.config().clone(),
            iteration: self.trainer.iteration(),
            state: self.trainer.download()?,
            statistics: self.trainer.statistics()?,
            colors: self.trainer.pending_colors()?,
            fingerprint: fingerprint(self.dataset),
            controller: controller.transpose()?,
            exposure: self.trainer.exposure()?,
            poses: self.trainer.poses()?.map(|poses| poses.state().clone()),
            transients: self.trainer.transients()?.map(|patches| patches.state().clone()),
        };
        checkpoint.write(path)
    }

    /// Begins the next iteration and lets the controller act; returns the report of an earlier step, if one has
    /// finished.
    ///
    /// # Errors
    /// [`Error::Step`] names the iteration; the run can then only be resumed from a checkpoint.
    pub fn step(&mut self) -> Result<Option<StepReport>> {
        let report = self.trainer.step()?;
        if let Some(controller) = &mut self.controller {
            controller.after_step(&mut self.trainer)?;
        }
        Ok(report)
    }

    /// Waits for all steps begun and returns the reports still outstanding.
    pub fn finish(&mut self) -> Result<Vec<StepReport>> {
        self.trainer.finish()
    }

    /// Splats after the last step begun; waits for it.
    pub fn splats(&mut self) -> Result<Splats> {
        self.trainer.splats()
    }

    /// Exposures of the photographs after the last step begun, in the order of the training views; `None` if the run
    /// has none. Waits for it.
    pub fn exposure(&mut self) -> Result<Option<ExposureGains>> {
        self.trainer.exposure()
    }

    /// Refined poses after the last step begun; `None` if the run keeps the given ones. Waits for it.
    pub fn poses(&mut self) -> Result<Option<&RefinedPoses>> {
        self.trainer.poses()
    }

    /// Patches left out after the last step begun; `None` if the run does not ignore transients. Waits for it.
    pub fn transients(&mut self) -> Result<Option<&IgnoredPatches>> {
        self.trainer.transients()
    }

    /// See [`Trainer::refined_dataset`].
    pub fn refined_dataset(&mut self) -> Result<Option<Dataset>> {
        self.trainer.refined_dataset()
    }

    /// Steps begun.
    pub fn iteration(&self) -> u32 {
        self.trainer.iteration()
    }

    /// Iteration at which the run ends, as far as known.
    pub fn end(&self) -> u32 {
        let controller = self.controller.as_ref();
        controller.map_or(self.config().iterations, C::end)
    }

    /// Whether all steps have been begun.
    pub fn is_done(&self) -> bool {
        self.iteration() >= self.end()
    }

    /// Constants of the run.
    pub fn config(&self) -> &TrainConfig {
        self.trainer.config()
    }

    /// Controller of the run, if it has one.
    pub fn controller(&self) -> Option<&C> {
        self.controller.as_ref()
    }

    /// Trainer of the run.
    pub fn trainer(&self) -> &Trainer<'a> {
        &self.trainer
    }
}

/// State of a controller of this type from a checkpoint.
fn typed<'a, C: Controller<'a>>(path: &Path, saved: &ControllerState) -> Result<C::State> {
    let refuse = |text: String| Err(Error::file(path, text));
    if saved.name != C::NAME {
        let (found, known) = (&saved.name, C::NAME);
        return refuse(format!("belongs to a run under the controller {found}, not {known}"));
    }
    if saved.version != C::VERSION {
        let (found, known) = (saved.version, C::VERSION);
        return refuse(format!(
            "has a controller state of version {found}; this program goes on from version {known}"
        ));
    }
    serde_json::from_value(saved.state.clone())
        .or_else(|e| refuse(format!("has a controller state that cannot be read: {e}")))
}
