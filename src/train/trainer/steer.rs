//! Changes between two steps by a run's controller: views, state, degrees of harmonics, splat limit. A
//! resumed run needs the same changes.

use super::Trainer;
use crate::train::colors::{ColorQueue, PendingColors};
use crate::train::state::HostState;
use crate::{Error, Result};

impl Trainer<'_> {
    /// Indices of the views trained on.
    pub fn views(&self) -> &[usize] {
        &self.views
    }

    /// Trains on these views of the data set from now on. Waits for the last step begun.
    pub fn set_views(&mut self, views: Vec<usize>) -> Result<()> {
        if views.is_empty() {
            return Err(Error::Config("there is no view to train on".into()));
        }
        if views == self.views {
            return Ok(());
        }
        if self.exposure.is_some() || self.poses.is_some() || self.transients.is_some() {
            let what = "the views of a run with exposures, refined poses or ignored transients cannot change: train \
                        without --exposure, --refine-poses and --against transients";
            return Err(Error::Config(what.into()));
        }
        self.settle()?;
        self.reload(views)
    }

    /// Sets the splat limit, at most that of the configuration.
    pub fn set_limit(&mut self, limit: usize) {
        self.limit = limit.min(self.config.splat_limit());
    }

    /// Restores the statistics from [`Trainer::statistics`] when a run is resumed.
    pub fn set_statistics(&mut self, statistics: &[[f32; 4]]) -> Result<()> {
        self.gpu.upload(&self.state.buffers.statistics, 0, statistics)
    }

    /// Gradients of colours that wait for an update of the harmonics, for a checkpoint; waits for the last step begun.
    pub fn pending_colors(&mut self) -> Result<PendingColors> {
        self.settle()?;
        let waiting = self.colors.waiting(&self.config, self.iteration);
        self.state.download_colors(&self.gpu, waiting)
    }

    /// Restores [`Trainer::pending_colors`] when a run is resumed.
    pub fn set_pending_colors(&mut self, colors: &PendingColors) -> Result<()> {
        self.colors = ColorQueue::new(self.iteration, &colors.positions);
        self.state.upload_colors(&self.gpu, colors)
    }

    /// Replaces the state, also by one with more or fewer splats, and clears the statistics of density control and the
    /// gradients that wait. Waits for the last step begun.
    pub fn replace(&mut self, state: &HostState) -> Result<()> {
        self.settle()?;
        self.take_over(state).map_err(|e| e.at_step(self.iteration))
    }

    /// Removes each splat's SH coefficients above a degree, with their memory and time: see
    /// [`HostState::lower_degrees`]. Statistics of density control stay. Waits for the last step begun.
    ///
    /// Panics unless there is a degree for every splat.
    pub fn lower_degrees(&mut self, degrees: &[u8]) -> Result<()> {
        let statistics = self.statistics()?;
        let mut state = self.download()?;
        state.lower_degrees(degrees);
        self.take_over(&state)?;
        self.set_statistics(&statistics)
    }

    /// Returns to the state after an earlier iteration.
    pub fn go_back(&mut self, state: &HostState, iteration: u32) -> Result<()> {
        self.replace(state)?;
        assert!(iteration <= self.iteration, "only what has been can be gone back to");
        self.iteration = iteration;
        self.colors = ColorQueue::new(iteration, &[]);
        Ok(())
    }

    /// Waits for all steps begun. [`Trainer::step`] returns their reports.
    pub(super) fn settle(&mut self) -> Result<()> {
        let reports = self.finish()?;
        self.done.extend(reports);
        Ok(())
    }
}
