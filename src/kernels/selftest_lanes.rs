//! Self-test of communication between the lanes of a workgroup.

pub use super::generated::selftest_lanes::*;
use crate::gpu::Caps;

impl Choice {
    /// A variant as in the engine: a workgroup in one subgroup, with an even number of lanes.
    pub fn of_variant(caps: &Caps, variant: Variant) -> Choice {
        let workgroup = caps.subgroup_size.min(caps.max_workgroup).max(2);
        Choice {
            variant,
            spec: Spec { workgroup },
        }
    }
}
