//! Last of three passes of an exclusive prefix sum: every value's offset.

pub use super::generated::scan_apply::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct ScanApply {
    kernel: Kernel,
}

impl ScanApply {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<ScanApply> {
        Ok(ScanApply {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `groups` workgroups.
    pub fn record(
        &self,
        rec: &mut Recorder<'_>,
        io: Bindings<'_>,
        params: Params,
        groups: Groups<'_>,
    ) {
        self.kernel.record(rec, io, params, groups);
    }
}
