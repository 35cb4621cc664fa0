//! Reads the tile counts of the visible splats in depth order.

pub use super::generated::gather::{Bindings, Choice, Kernel, Spec, Variant};
use crate::Result;
use crate::gpu::{Buffer, Caps, Gpu, Groups, Recorder};
use crate::layout::DispatchArgs;

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Gather {
    kernel: Kernel,
}

impl Gather {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Gather> {
        Ok(Gather {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it; element `index` of `groups` holds the dispatch size that `plan` derived.
    pub fn record(
        &self,
        rec: &mut Recorder<'_>,
        io: Bindings<'_>,
        groups: &Buffer<DispatchArgs>,
        index: u32,
    ) {
        self.kernel
            .record(rec, io, Groups::indirect(groups, index as usize));
    }
}
