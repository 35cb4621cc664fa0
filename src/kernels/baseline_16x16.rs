//! A baseline, never chosen to draw: compositing with one pixel per invocation and shared batches.

pub use super::generated::baseline_16x16::{Bindings, Choice, Kernel, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// Width and height of its tiles, pixels (`BASELINE_TILE` in baseline_16x16.glsl).
pub const TILE: u32 = 16;

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Baseline16x16 {
    kernel: Kernel,
}

impl Baseline16x16 {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Baseline16x16> {
        Ok(Baseline16x16 {
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
