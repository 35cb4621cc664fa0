//! Self-test of what the lanes of a workgroup tell each other.

pub use super::generated::selftest_lanes::*;
use crate::gpu::Caps;

impl Choice {
    /// A variant as the engine would run it: a workgroup that lies in one subgroup, of an even number of lanes.
    pub fn of_variant(caps: &Caps, variant: Variant) -> Choice {
        let workgroup = caps.subgroup_size.min(caps.max_workgroup).max(2);
        Choice {
            variant,
            spec: Spec { workgroup },
        }
    }
}
