//! Writes a composited image into a host's storage image.

pub use super::generated::present::{Bindings, Choice, Kernel, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Present {
    kernel: Kernel,
}

impl Present {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Present> {
        Ok(Present {
            kernel: Kernel::new(gpu, choice)?,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over an image of `size` pixels.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, size: [u32; 2]) {
        self.kernel.record(
            rec,
            io,
            Groups::Grid([size[0].div_ceil(8), size[1].div_ceil(8), 1]),
        );
    }
}
