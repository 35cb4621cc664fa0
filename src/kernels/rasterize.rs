//! Composites the sorted splats of every tile into an image, front to back.

pub use super::generated::rasterize::*;
use crate::gpu::{Caps, DeviceKind};
use crate::shader::KernelInfo;

/// Whether a device composites a tile within one subgroup by `kernel`, and the lanes of a workgroup: as many as
/// leave each at least four pixels.
fn lanes(caps: &Caps, kernel: &KernelInfo) -> (bool, u32) {
    let subgroup = caps.supports(kernel).is_ok() && caps.subgroup_size >= 8;
    (
        subgroup,
        if subgroup {
            caps.subgroup_size.min(32)
        } else {
            8
        },
    )
}

/// Why [`lanes`] are as many, in a sentence.
fn why(caps: &Caps, kernel: &KernelInfo) -> &'static str {
    match (lanes(caps, kernel), caps.kind) {
        ((true, _), DeviceKind::Cpu) => {
            "one subgroup a tile, many pixels a lane: lanes fetch a splat each, pass it round and agree without \
             shared memory"
        }
        ((true, _), _) => {
            "one subgroup a tile, at least four pixels a lane: lanes pass splats round and agree without shared \
             memory (by design; not measured on this class of devices)"
        }
        _ => {
            "no subgroup of eight lanes or more can do all that it takes here: eight lanes share memory instead"
        }
    }
}

/// What a frame leaves besides its image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outputs {
    /// Expected depth.
    pub depth: bool,
    /// Where each pixel ended, which gradients are found from.
    pub ends: bool,
}

impl Outputs {
    /// What a training step needs.
    pub const TRAINING: Outputs = Outputs {
        depth: false,
        ends: true,
    };
}

/// Choices of the kernels that walk the list of each tile as compositing does.
macro_rules! choices {
    ($($kernel:ident)*) => {$(
        impl super::generated::$kernel::Choice {
            /// Choice for a device: lanes of one subgroup where it can vote and add, as many as make four pixels or
            /// more a lane.
            pub fn prefer(caps: &Caps) -> Self {
                use super::generated::$kernel::Variant;
                let (subgroup, workgroup) = lanes(caps, Variant::Subgroup.info());
                let mut choice = Self::default();
                choice.spec.workgroup = workgroup;
                if subgroup {
                    choice.variant = Variant::Subgroup;
                }
                choice
            }

            /// Why that is preferred, in a sentence.
            pub fn why(caps: &Caps) -> &'static str {
                use super::generated::$kernel::Variant;
                why(caps, Variant::Subgroup.info())
            }
        }
    )*};
}

choices! { contribution prune_limit rasterize rasterize_backward removal_error }

impl Choice {
    /// The same choice for a frame with these outputs.
    #[must_use]
    pub fn of_outputs(mut self, outputs: Outputs) -> Choice {
        self.spec.with_depth = outputs.depth.into();
        self.spec.with_ends = outputs.ends.into();
        self
    }
}
