//! Adds up the tiles' loss terms.

pub use super::generated::loss_sum::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct LossSum {
    kernel: Kernel,
}

impl LossSum {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<LossSum> {
        Ok(LossSum {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it: one workgroup does all.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params) {
        self.kernel.record(rec, io, params, Groups::Count(1));
    }
}
