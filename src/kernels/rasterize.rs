//! Composites the sorted splats of every tile into an image, front to back.

pub use super::generated::rasterize::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Buffer, Caps, DeviceKind, Gpu, Groups, Recorder};
use crate::layout::DispatchArgs;
use crate::shader::KernelInfo;

/// Whether a device composites a tile within one subgroup by `kernel`, and the lanes of a workgroup: as many as
/// leave each at least four pixels.
pub(super) fn lanes(caps: &Caps, kernel: &KernelInfo) -> (bool, u32) {
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
pub(super) fn why(caps: &Caps, kernel: &KernelInfo) -> &'static str {
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

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Rasterize {
    kernel: Kernel,
}

impl Rasterize {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Rasterize> {
        Ok(Rasterize {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: lanes of one subgroup where it can vote and add, as many as make
    /// four pixels or more a lane.
    pub fn prefer(caps: &Caps, outputs: Outputs) -> Choice {
        let (subgroup, workgroup) = lanes(caps, Variant::Subgroup.info());
        let variant = if subgroup {
            Variant::Subgroup
        } else {
            Variant::Base
        };
        Choice {
            variant,
            spec: Spec {
                workgroup,
                with_depth: outputs.depth.into(),
                with_ends: outputs.ends.into(),
                ..Spec::default()
            },
        }
    }

    /// Why that is preferred, in a sentence.
    pub fn why(caps: &Caps) -> &'static str {
        why(caps, Variant::Subgroup.info())
    }

    /// Records it over `tiles` tiles.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params, tiles: usize) {
        self.kernel
            .record(rec, io, params, Groups::Count(tiles as u32));
    }

    /// Records it; element `index` of `groups` holds the dispatch size that `plan` derived.
    pub fn record_planned(
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
