//! MCMC's exploration noise on the means.

pub use super::generated::perturb::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Perturb {
    kernel: Kernel,
    workgroup: u32,
}

impl Perturb {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Perturb> {
        Ok(Perturb {
            kernel: Kernel::new(gpu, choice)?,
            workgroup: choice.spec.workgroup,
        })
    }

    /// Which variant and tuning suits a device: one serves all so far.
    pub fn prefer(_caps: &Caps) -> Choice {
        Choice::default()
    }

    /// Records it over `count` splats.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params, count: usize) {
        self.kernel.record(
            rec,
            io,
            params,
            Groups::Count((count as u32).div_ceil(self.workgroup)),
        );
    }
}
