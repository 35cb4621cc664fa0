//! Lists one intersection for every tile that a visible splat touches.

pub use super::generated::expand::*;
use super::subgroups_help;
use crate::gpu::Caps;

impl Choice {
    /// Choice for a device.
    pub fn prefer(caps: &Caps) -> Choice {
        let mut choice = Choice::default();
        if subgroups_help(caps, Variant::Subgroup.info(), Spec::default().workgroup) {
            choice.variant = Variant::Subgroup;
        }
        choice
    }

    /// Reason for that choice, one sentence.
    pub fn why(caps: &Caps) -> &'static str {
        match subgroups_help(caps, Variant::Subgroup.info(), Spec::default().workgroup) {
            true => "a subgroup lists the tiles of each splat with many, and no lane waits for another's splat",
            false => "each invocation lists its splat's tiles: a processor runs one lane after the other",
        }
    }
}
