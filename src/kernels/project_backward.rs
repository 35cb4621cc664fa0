//! Gradient of every parameter of every splat, from the records that compositing left.

pub use super::generated::project_backward::{Bindings, Choice, Kernel, Params, Spec, Variant};
use crate::Result;
use crate::gpu::{Caps, Gpu, Groups, Recorder};

/// The kernel, ready to record.
#[derive(Debug)]
pub struct ProjectBackward {
    kernel: Kernel,
    workgroup: u32,
}

impl ProjectBackward {
    /// Compiles it as chosen.
    pub fn new(gpu: &Gpu, choice: Choice) -> Result<ProjectBackward> {
        Ok(ProjectBackward {
            kernel: Kernel::new(gpu, choice)?,
            workgroup: choice.spec.workgroup,
        })
    }

    /// One for splats of each degree up to `highest`; `indexed`: whose slots are in an order of their own.
    pub fn of_degrees(gpu: &Gpu, highest: u32, indexed: bool) -> Result<Vec<ProjectBackward>> {
        let kernel = |degree| {
            let mut choice = ProjectBackward::prefer(gpu.caps(), degree);
            choice.spec.indexed = indexed.into();
            ProjectBackward::new(gpu, choice)
        };
        (0..=highest).map(kernel).collect()
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
