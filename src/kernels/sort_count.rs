//! First half of a pass of a stable radix sort: how often each digit occurs in each chunk of keys.

pub use super::generated::sort_count::{Bindings, Choice, Kernel, Params, Spec, Variant};
use super::sort::{SUBGROUP_WORKGROUP, by_subgroup};
use crate::Result;
use crate::gpu::{Buffer, Caps, Gpu, Groups, Recorder};
use crate::layout::DispatchArgs;

/// The kernel, ready to record.
#[derive(Debug)]
pub struct SortCount {
    kernel: Kernel,
}

impl SortCount {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<SortCount> {
        Ok(SortCount {
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
