//! Second of three passes of an exclusive prefix sum: the chunks' sums, in place, and the total.

pub use super::generated::scan_chunks::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct ScanChunks {
    kernel: Kernel,
}

impl ScanChunks {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<ScanChunks> {
        Ok(ScanChunks {
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
