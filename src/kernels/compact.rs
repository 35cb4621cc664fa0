//! Lists the visible splats in the order of their index, with their depth as a sortable key.

pub use super::generated::compact::{Bindings, Choice, Kernel, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Compact {
    kernel: Kernel,
    workgroup: u32,
}

impl Compact {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Compact> {
        Ok(Compact {
            kernel: Kernel::new(gpu, choice)?,
            workgroup: choice.spec.workgroup,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `count` splats.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, count: usize) {
        self.kernel.record(
            rec,
            io,
            Groups::Count((count as u32).div_ceil(self.workgroup)),
        );
    }
}
