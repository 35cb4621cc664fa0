//! What the pixels of a tile would lose with each of its splats.

pub use super::generated::contribution::{Bindings, Choice, Kernel, Params, Spec, Variant};
use super::rasterize::{lanes, why};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Contribution {
    kernel: Kernel,
}

impl Contribution {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Contribution> {
        Ok(Contribution {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: that of compositing, whose walk it repeats.
    pub fn prefer(caps: &Caps) -> Choice {
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
}
