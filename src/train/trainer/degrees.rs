//! Harmonics that turn out not to be needed, taken away between two steps.

use super::Trainer;
use crate::Result;

impl Trainer<'_> {
    /// Takes from every splat's colour what is above a degree, and its memory and time with it: see
    /// [`HostState::lower_degrees`](crate::train::HostState::lower_degrees). What density control has gathered stays.
    /// Waits for the last step begun.
    ///
    /// Panics unless there is a degree for every splat.
    pub fn lower_degrees(&mut self, degrees: &[u8]) -> Result<()> {
        let statistics = self.statistics()?;
        let mut state = self.download()?;
        state.lower_degrees(degrees);
        self.take_over(&state)?;
        self.set_statistics(&statistics)
    }

    /// Compiles what steps from the state as it lies on the device need.
    pub(super) fn prepare(&mut self) -> Result<()> {
        let model = &self.state.model;
        self.forward.prepare(&self.gpu, model)?;
        self.backward.prepare(&self.gpu, model)
    }
}
