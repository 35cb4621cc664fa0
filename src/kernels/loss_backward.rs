//! Gradient of the loss by every pixel of the render.

pub use super::generated::loss_backward::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct LossBackward {
    kernel: Kernel,
}

impl LossBackward {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<LossBackward> {
        Ok(LossBackward {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `tiles` tiles of `LOSS_TILE_WIDTH` x `LOSS_TILE_HEIGHT` pixels.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params, tiles: usize) {
        self.kernel
            .record(rec, io, params, Groups::Count(tiles as u32));
    }
}
