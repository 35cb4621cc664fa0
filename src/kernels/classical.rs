//! A yardstick, never chosen to draw: compositing with one pixel per invocation and shared batches.

pub use super::generated::classical::{Bindings, Choice, Kernel, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// Width and height of its tiles, pixels (`CLASSICAL_TILE` in classical.glsl).
pub const TILE: u32 = 16;

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Classical {
    kernel: Kernel,
}

impl Classical {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Classical> {
        Ok(Classical {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: there is one.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `tiles` tiles of its own size.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, tiles: usize) {
        self.kernel.record(rec, io, Groups::Count(tiles as u32));
    }
}
