//! Finds each splat's ellipse, colour and depth on the screen, and how many tiles it touches.

pub use super::generated::project::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct Project {
    kernel: Kernel,
    workgroup: u32,
}

impl Project {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<Project> {
        Ok(Project {
            kernel: Kernel::new(gpu, choice)?,
            workgroup: choice.spec.workgroup,
        })
    }

    /// Which variant and tuning suits a device, for splats of `sh_degree`.
    pub fn prefer(_caps: &Caps, sh_degree: u32) -> Choice {
        Choice {
            spec: Spec {
                sh_degree,
                ..Spec::default()
            },
            ..Choice::default()
        }
    }

    /// Records it over `params.splat_count` splats.
    pub fn record(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, params: Params) {
        let groups = Groups::Count(params.splat_count.div_ceil(self.workgroup));
        self.kernel.record(rec, io, params, groups);
    }
}
