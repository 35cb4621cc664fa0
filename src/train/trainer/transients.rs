//! Patches of the photographs that are left out, between steps.

use super::{StepInFlight, Trainer};
use crate::scene::Dataset;
use crate::train::config::TrainConfig;
use crate::train::schedule;
use crate::train::transients::{IgnoredPatches, PatchGrid, TransientState};
use crate::{Error, Result};

/// Patches of a run that ignores transients.
pub(super) fn begin(
    dataset: &Dataset,
    config: &TrainConfig,
    saved: Option<TransientState>,
) -> Result<Option<IgnoredPatches>> {
    if !config.ignore_transients {
        return Ok(None);
    }
    let patches = IgnoredPatches::new(dataset, saved);
    let other = || Error::Config("the saved patches are those of other photographs".into());
    patches.ok_or_else(other).map(Some)
}

impl Trainer<'_> {
    /// Patches left out after the last step begun; `None` if the run does not ignore transients. Waits for it.
    pub fn transients(&mut self) -> Result<Option<&IgnoredPatches>> {
        self.settle()?;
        Ok(self.transients.as_ref())
    }

    /// Patches of the photograph at a place, at the size that steps use, and a bit of each: ignored. Photographs that
    /// are too small to be halved as often as others have none in steps at reduced size.
    pub(super) fn patches(&self, place: usize) -> (Option<PatchGrid>, Vec<u32>) {
        let Some(transients) = &self.transients else {
            return (None, Vec::new());
        };
        let (grid, words) = (transients.grid(place), transients.words(place).to_vec());
        let Some(coarse) = &self.coarse else {
            return (Some(grid), words);
        };
        let full = &self.dataset.views[self.views[place]].camera;
        let camera = &coarse.dataset.views[place].camera;
        let is_reduced = |whole: u32, part: u32| whole.div_ceil(1 << coarse.halvings) == part;
        let fits = is_reduced(full.width, camera.width) && is_reduced(full.height, camera.height);
        match grid.halved(coarse.halvings).filter(|_| fits) {
            Some(grid) => (Some(grid), words),
            None => (None, vec![0]),
        }
    }

    /// Adds the residuals of a finished step.
    pub(super) fn score_patches(&mut self, step: &StepInFlight) {
        let is_visit = schedule::is_transient_visit(&self.config, step.iteration);
        if let (Some(transients), Some(residuals), true) = (&mut self.transients, step.residuals(), is_visit) {
            transients.add(step.photo, &residuals);
        }
    }

    /// Finds the patches to be ignored anew, if this iteration does, at the end of an epoch. No step may be in flight.
    pub(super) fn update_transients(&mut self, iteration: u32) {
        let is_due = schedule::is_transient_update(&self.config, self.views.len(), iteration);
        if let Some(transients) = self.transients.as_mut().filter(|_| is_due) {
            transients.update(&self.config.transients);
        }
    }
}
