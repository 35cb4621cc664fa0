//! Views into a trainer for tests, which judge a step by what it saw and what it went by. Nothing else needs
//! them, so the documentation does not show them.

use super::Trainer;
use crate::Result;
use crate::render::Capacity;
use crate::train::state::Planes;

impl Trainer<'_> {
    /// Keeps all gradients of the steps to come, for [`Trainer::gradients`], until sizes change.
    #[doc(hidden)]
    pub fn keep_gradients(&mut self) -> Result<()> {
        self.settle()?;
        self.state.keep_gradients(&self.gpu)
    }

    /// The gradient that the last step begun went by, `[plane][splat]` like the parameters; waits for it.
    #[doc(hidden)]
    pub fn gradients(&mut self) -> Result<Planes> {
        self.settle()?;
        self.state.download_gradients(&self.gpu)
    }

    /// The picture that the last step begun compared with its photograph, `[plane][pixel]`: red, green, blue,
    /// transmittance; waits for it. Only meaningful where all views have the same size.
    #[doc(hidden)]
    pub fn image(&mut self) -> Result<Vec<f32>> {
        self.settle()?;
        let image = &self.scratch.image;
        self.gpu.download(image, 0..image.len())
    }

    /// Gives the steps to come room for so many (splat, tile) pairs, until one wants more.
    #[doc(hidden)]
    pub fn set_isect_capacity(&mut self, isects: usize) -> Result<()> {
        self.settle()?;
        self.resize(Capacity {
            isects,
            ..self.scratch.capacity
        })
    }

    pub(super) fn settle(&mut self) -> Result<()> {
        let reports = self.finish()?;
        self.done.extend(reports);
        Ok(())
    }
}
