//! Adds a view's records up by splat, to what the views before have come to.

pub use super::generated::sum_by_splat::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct SumBySplat {
    kernel: Kernel,
    workgroup: u32,
}

impl SumBySplat {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<SumBySplat> {
        Ok(SumBySplat {
            kernel: Kernel::new(gpu, choice)?,
            workgroup: choice.spec.workgroup,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `params.splat_count` splats.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params) {
        let groups = Groups::Count(params.splat_count.div_ceil(self.workgroup));
        self.kernel.record(rec, io, params, groups);
    }
}
