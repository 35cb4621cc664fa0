//! A baseline, never chosen to train: the gradient of `baseline_16x16`, added up atomically.

pub use super::generated::baseline_16x16_backward::{Bindings, Choice, Kernel, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Baseline16x16Backward {
    kernel: Kernel,
}

impl Baseline16x16Backward {
    /// Compiles it as chosen.
    ///
    /// # Errors
    /// Where floats cannot be added atomically, among others.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Baseline16x16Backward> {
        Ok(Baseline16x16Backward {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: there is one.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `tiles` tiles of its own size, after clearing the sums.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, tiles: usize) {
        rec.fill(io.sum_from_splat, 0);
        self.kernel.record(rec, io, Groups::Count(tiles as u32));
    }
}
