//! Composites the sorted splats of every tile into an image, front to back.

pub use super::generated::rasterize::*;
use super::subgroups_help;
use crate::gpu::{Caps, DeviceKind};
use crate::layout::{SURFEL_ANY, SURFEL_MIP, SURFEL_NONE};
use crate::shader::KernelInfo;

/// True if a device composites a tile within one subgroup by `kernel`, and the lanes of a workgroup, with at least four
/// pixels each.
fn lanes(caps: &Caps, kernel: &KernelInfo) -> (bool, u32) {
    let subgroup = caps.supports(kernel).is_ok() && caps.subgroup_size >= 8;
    (subgroup, if subgroup { caps.subgroup_size.min(32) } else { 8 })
}

/// Lanes of a tile in blocks of rows.
const BLOCK_LANES: u32 = 64;

/// Shared memory of such a workgroup, bytes, at most.
const BLOCK_SHARED: u32 = 16 << 10;

/// True if a device that composites within subgroups does so in blocks by `kernel`.
fn by_blocks(caps: &Caps, kernel: &KernelInfo) -> bool {
    let fits = caps.max_workgroup >= BLOCK_LANES && caps.max_shared >= BLOCK_SHARED;
    fits && subgroups_help(caps, kernel, BLOCK_LANES)
}

/// Reason for the choice of a kernel with these variants, one sentence.
fn why(caps: &Caps, subgroup: &KernelInfo, best: &KernelInfo) -> &'static str {
    match (lanes(caps, subgroup), caps.kind) {
        ((true, _), _) if best.variant != subgroup.variant && by_blocks(caps, best) => {
            "two pixels a lane, and a block of rows a subgroup, which passes over splats that miss it; surfaces and \
             surfels have one subgroup a tile"
        }
        ((true, _), DeviceKind::Cpu) => {
            "one subgroup a tile, many pixels a lane: lanes fetch a splat each, pass it round and agree without \
             shared memory"
        }
        ((true, _), _) => {
            "one subgroup a tile, at least four pixels a lane: lanes pass splats round and agree without shared memory"
        }
        _ => "no subgroup of eight lanes or more can do all that it takes here: eight lanes share memory instead",
    }
}

/// Surfels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SurfelMode {
    /// 3D Gaussians instead.
    #[default]
    Absent,
    /// In either mode; each frame's own decides.
    Any,
    /// In mip mode alone, where they are never spots: shorter records, and fewer operations.
    Mip,
}

impl From<SurfelMode> for u32 {
    fn from(mode: SurfelMode) -> u32 {
        match mode {
            SurfelMode::Absent => SURFEL_NONE,
            SurfelMode::Any => SURFEL_ANY,
            SurfelMode::Mip => SURFEL_MIP,
        }
    }
}

/// Optional outputs of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outputs {
    /// Expected depth.
    pub depth: bool,
    /// End of each pixel's list, from which gradients are computed.
    pub ends: bool,
    /// Depths and normals of the splats' planes; not by the rules of the 3DGS code.
    pub surface: bool,
    /// Sums for the spread of the planes' depths in a pixel, beside those of `surface`.
    pub spread: bool,
    /// Limits of depth, which are an input, but take memory and kernels of their own as outputs do.
    pub limit: bool,
    /// Surfels in place of 3D Gaussians, which take memory and kernels of their own, too.
    pub surfels: SurfelMode,
    /// Splat at which each pixel's coverage reaches 1/2, in place of the end of its list; not by the rules of the 3DGS
    /// code.
    pub ids: bool,
}

impl Outputs {
    /// Outputs for a training step.
    pub const TRAINING: Outputs = Outputs {
        depth: false,
        ends: true,
        surface: false,
        spread: false,
        limit: false,
        surfels: SurfelMode::Absent,
        ids: false,
    };

    /// Whether frames need the planes of splats.
    pub fn has_planes(&self) -> bool {
        self.surface || self.surfels != SurfelMode::Absent
    }
}

/// Choices of the kernels that walk each tile's list, with the best variant for many lanes.
macro_rules! choices {
    ($($kernel:ident: $best:ident;)*) => {$(
        impl super::generated::$kernel::Choice {
            /// Choice for a device and frames with these outputs: blocks of rows on devices of many lanes, where a
            /// variant has them; else one subgroup if it can vote and add, with at least four pixels a lane.
            pub fn prefer(caps: &Caps, outputs: Outputs) -> Self {
                use super::generated::$kernel::Variant;
                let (subgroup, workgroup) = lanes(caps, Variant::Subgroup.info());
                let mut choice = Self::default();
                choice.spec.workgroup = workgroup;
                if subgroup {
                    choice.variant = Variant::Subgroup;
                }
                let best = Variant::$best;
                let has_blocks = subgroup && best != Variant::Subgroup && by_blocks(caps, best.info());
                if has_blocks && !outputs.has_planes() {
                    choice.variant = best;
                    choice.spec.workgroup = BLOCK_LANES;
                }
                choice.of_outputs(outputs)
            }

            /// Reason for that choice, one sentence.
            pub fn why(caps: &Caps) -> &'static str {
                use super::generated::$kernel::Variant;
                why(caps, Variant::Subgroup.info(), Variant::$best.info())
            }
        }
    )*};
}

choices! {
    contribution: Subgroup;
    prune_limit: Subgroup;
    rasterize: Blocks;
    rasterize_backward: Blocks;
    removal_error: Subgroup;
}

/// Outputs of the kernels that composite.
macro_rules! outputs {
    ($($kernel:ident: $($constant:ident $output:ident),*;)*) => {$(
        impl super::generated::$kernel::Choice {
            /// The same choice for a frame with these outputs.
            #[must_use]
            pub fn of_outputs(mut self, outputs: Outputs) -> Self {
                $(self.spec.$constant = outputs.$output.into();)*
                self
            }
        }
    )*};
}

outputs! {
    rasterize: with_depth depth, with_ends ends, with_surface surface, with_limit limit,
        surfel surfels, with_ids ids, with_spread spread;
    rasterize_backward: surfel surfels, with_surface surface, with_spread spread;
    rasterize_inria: with_depth depth, with_ends ends;
    project_backward: surfel surfels, with_surface surface;
    contribution: surfel surfels;
    prune_limit: surfel surfels;
    removal_error: surfel surfels;
}
