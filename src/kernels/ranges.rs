//! Finds, for every tile, the slice of the sorted intersections that belongs to it.

pub use super::generated::ranges::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Buffer, Caps, Gpu, Groups, Recorder};
use crate::layout::DispatchArgs;

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Ranges {
    kernel: Kernel,
}

impl Ranges {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Ranges> {
        Ok(Ranges {
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
        params: Params,
        groups: &Buffer<DispatchArgs>,
        index: u32,
    ) {
        self.kernel
            .record(rec, io, params, Groups::indirect(groups, index as usize));
    }
}
