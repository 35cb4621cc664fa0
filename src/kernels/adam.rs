//! One step of Adam on every parameter.

pub use super::generated::adam::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Adam {
    kernel: Kernel,
    workgroup: u32,
}

impl Adam {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Adam> {
        Ok(Adam {
            kernel: Kernel::new(gpu, choice)?,
            workgroup: choice.spec.workgroup,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `planes` planes of `params.splat_count` splats.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params, planes: usize) {
        let row = params.splat_count.div_ceil(self.workgroup);
        let groups = Groups::Grid([row, planes as u32, 1]);
        self.kernel.record(rec, io, params, groups);
    }
}
