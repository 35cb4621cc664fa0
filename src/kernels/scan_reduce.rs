//! First of three passes of an exclusive prefix sum: the sum of every chunk of `SCAN_CHUNK` values.

pub use super::generated::scan_reduce::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct ScanReduce {
    kernel: Kernel,
}

impl ScanReduce {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<ScanReduce> {
        Ok(ScanReduce {
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
