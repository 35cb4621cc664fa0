//! Composites the sorted splats of every tile as the code of the 3DGS paper does.

pub use super::generated::rasterize_inria::{Bindings, Choice, Kernel, Params, Spec, Variant};
use super::rasterize::Outputs;
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct RasterizeInria {
    kernel: Kernel,
}

impl RasterizeInria {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<RasterizeInria> {
        Ok(RasterizeInria {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: one serves all.
    pub fn prefer(_caps: &Caps, outputs: Outputs) -> Choice {
        Choice {
            spec: Spec {
                with_depth: outputs.depth.into(),
                with_ends: outputs.ends.into(),
                ..Spec::default()
            },
            ..Choice::default()
        }
    }

    /// Records it over `tiles` tiles.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params, tiles: usize) {
        self.kernel
            .record(rec, io, params, Groups::Count(tiles as u32));
    }
}
