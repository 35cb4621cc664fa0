//! Access to a trainer's internals; that for tests and measurements of single steps is hidden from the documentation.

use super::Trainer;
use crate::Result;
use crate::render::Capacity;
use crate::train::state::Planes;

impl Trainer<'_> {
    /// Statistics of density control since the last refinement; waits for the last step begun.
    pub fn statistics(&mut self) -> Result<Vec<[f32; 4]>> {
        self.settle()?;
        let statistics = self.state.download_statistics(&self.gpu);
        statistics.map_err(|e| e.at_step(self.iteration))
    }

    /// Keeps all gradients of the next steps, for [`Trainer::gradients`], until sizes change.
    #[doc(hidden)]
    pub fn keep_gradients(&mut self) -> Result<()> {
        self.settle()?;
        self.state.keep_gradients(&self.gpu)
    }

    /// Gradient of the last step begun, `[plane][splat]` like the parameters; waits for it.
    #[doc(hidden)]
    pub fn gradients(&mut self) -> Result<Planes> {
        self.settle()?;
        self.state.download_gradients(&self.gpu)
    }

    /// Rendering of the last step begun, `[plane][pixel]`: red, green, blue, transmittance; waits for it. Only
    /// meaningful if all views have the same size and none is drawn in bands of rows.
    #[doc(hidden)]
    pub fn image(&mut self) -> Result<Vec<f32>> {
        self.settle()?;
        let image = &self.scratch.image;
        self.gpu.download(image, 0..image.len())
    }

    /// Sets the capacity for (splat, tile) pairs, until a step needs more.
    #[doc(hidden)]
    pub fn set_isect_capacity(&mut self, isects: usize) -> Result<()> {
        self.settle()?;
        self.resize(Capacity {
            isects,
            ..self.scratch.capacity
        })
    }
}
