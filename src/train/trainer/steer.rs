//! What may be changed between two steps by whoever steers a run: which views it sees and how large, what it goes on
//! from, how far it may grow. A run that is resumed must be steered alike.

use super::Trainer;
use crate::train::state::HostState;
use crate::{Error, Result};

impl Trainer<'_> {
    /// The views trained on, of the data set's.
    pub fn views(&self) -> &[usize] {
        &self.views
    }

    /// Trains on these of the data set's views from now on. Waits for the last step begun.
    pub fn set_views(&mut self, views: Vec<usize>) -> Result<()> {
        if views.is_empty() {
            return Err(Error::Config("there is no view to train on".into()));
        }
        if views == self.views {
            return Ok(());
        }
        self.settle()?;
        self.reload(views)
    }

    /// Trains on photographs of half their width and height from now on, or on whole ones. Waits for the last step
    /// begun.
    pub fn set_half_size(&mut self, half_size: bool) -> Result<()> {
        self.settle()?;
        self.half_size = half_size;
        if self.halved.is_some() != self.is_half() {
            self.reload(self.views.clone())?;
        }
        Ok(())
    }

    /// From now on splats are added up to this count, and no more than the configuration allows.
    pub fn set_limit(&mut self, limit: usize) {
        self.limit = limit.min(self.config.splat_limit());
    }

    /// Puts back what [`Trainer::statistics`] gave, when a run is resumed.
    pub fn set_statistics(&mut self, statistics: &[[f32; 4]]) -> Result<()> {
        self.gpu.upload(&self.state.statistics, 0, statistics)
    }

    /// Tells the next refinement each splat's share in the pixels' errors, relatively to the mean splat's.
    ///
    /// Panics unless there is one for every splat.
    pub fn set_errors(&mut self, errors: Vec<f32>) {
        assert_eq!(errors.len(), self.splat_count(), "an error for every splat");
        self.errors = errors;
    }

    /// Goes on with another state in place of this one, which may have more splats or fewer; what density control has
    /// gathered is forgotten. Waits for the last step begun.
    pub fn replace(&mut self, state: &HostState) -> Result<()> {
        self.settle()?;
        self.take_over(state).map_err(|e| e.at_step(self.iteration))
    }

    /// Goes on from a state of an earlier iteration, as it was after that.
    pub fn go_back(&mut self, state: &HostState, iteration: u32) -> Result<()> {
        self.replace(state)?;
        assert!(
            iteration <= self.iteration,
            "only what has been can be gone back to"
        );
        self.iteration = iteration;
        Ok(())
    }
}
