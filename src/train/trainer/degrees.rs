//! Removal of SH coefficients between two steps.

use super::Trainer;
use crate::Result;

impl Trainer<'_> {
    /// Removes each splat's SH coefficients above a degree, with their memory and time: see
    /// [`HostState::lower_degrees`](crate::train::HostState::lower_degrees). Statistics of density control stay. Waits
    /// for the last step begun.
    ///
    /// Panics unless there is a degree for every splat.
    pub fn lower_degrees(&mut self, degrees: &[u8]) -> Result<()> {
        let statistics = self.statistics()?;
        let mut state = self.download()?;
        state.lower_degrees(degrees);
        self.take_over(&state)?;
        self.set_statistics(&statistics)
    }

    /// Compiles the kernels for steps from the state's current layout.
    pub(super) fn prepare(&mut self) -> Result<()> {
        let model = &self.state.model;
        self.forward.prepare(&self.gpu, model)?;
        self.backward.prepare(&self.gpu, model)
    }
}
