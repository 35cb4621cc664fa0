//! Self-test of what the lanes of a workgroup tell each other.

pub use super::generated::selftest_lanes::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct SelftestLanes {
    kernel: Kernel,
}

impl SelftestLanes {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<SelftestLanes> {
        Ok(SelftestLanes {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// A variant as the engine would run it: a workgroup that lies in one subgroup, of an even number of lanes.
    pub fn choice(caps: &Caps, variant: Variant) -> Choice {
        let workgroup = caps.subgroup_size.min(caps.max_workgroup).max(2);
        Choice {
            variant,
            spec: Spec { workgroup },
        }
    }

    /// Records it over `groups` workgroups.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params, groups: u32) {
        self.kernel.record(rec, io, params, Groups::Count(groups));
    }
}
