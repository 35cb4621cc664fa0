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

    /// Records it over `planes` planes of `params.splat_count` splats; fills in how planes share the workgroups.
    pub fn record(
        &self,
        rec: &mut Recorder<'_>,
        io: Bindings<'_>,
        mut params: Params,
        planes: usize,
    ) {
        params.groups_per_plane = params.splat_count.div_ceil(self.workgroup);
        self.kernel.record(
            rec,
            io,
            params,
            Groups::Count(params.groups_per_plane * planes as u32),
        );
    }
}
