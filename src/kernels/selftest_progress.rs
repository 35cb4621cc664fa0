//! Self-test of workgroups and barriers: whether all run and all arrive.

pub use super::generated::selftest_progress::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct SelftestProgress {
    kernel: Kernel,
}

impl SelftestProgress {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<SelftestProgress> {
        Ok(SelftestProgress {
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
