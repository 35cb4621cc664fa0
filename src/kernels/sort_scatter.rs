//! Second half of a pass of a stable radix sort: every key and value to its place.

pub use super::generated::sort_scatter::{Bindings, Choice, Kernel, Params, Spec, Variant};
use super::sort::{SUBGROUP_WORKGROUP, by_subgroup};
use crate::Result;
use crate::gpu::{Buffer, Caps, Gpu, Groups, Recorder};
use crate::layout::DispatchArgs;

/// The kernel, ready to record.
#[derive(Debug)]
pub struct SortScatter {
    kernel: Kernel,
}

impl SortScatter {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<SortScatter> {
        Ok(SortScatter {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: a workgroup per chunk where lanes are many and cheap, else an
    /// invocation per chunk.
    pub fn prefer(caps: &Caps) -> Choice {
        if !by_subgroup(caps) {
            return Choice::default();
        }
        Choice {
            variant: Variant::Subgroup,
            spec: Spec {
                workgroup: SUBGROUP_WORKGROUP,
            },
        }
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
