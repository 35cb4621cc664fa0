//! Turns a count that only the device knows into dispatch sizes, and notices what does not fit.

pub use super::generated::plan::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Plan {
    kernel: Kernel,
}

impl Plan {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Plan> {
        Ok(Plan {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it: one invocation does all.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params) {
        self.kernel.record(rec, io, params, Groups::Count(1));
    }
}
