//! Self-test of loops: whether they run to their end.

pub use super::generated::selftest_loops::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct SelftestLoops {
    kernel: Kernel,
}

impl SelftestLoops {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<SelftestLoops> {
        Ok(SelftestLoops {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: one serves all.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `groups` workgroups.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params, groups: u32) {
        self.kernel.record(rec, io, params, Groups::Count(groups));
    }
}
