//! Gradient of every parameter of every splat, from the records of compositing.

pub use super::generated::project_backward::*;
use super::rasterize::Outputs;
use super::subgroups_help;
use crate::Result;
use crate::gpu::{Caps, Gpu};

/// Choices of the kernels that read parameters.
macro_rules! of_degree {
    ($($kernel:ident)*) => {$(
        impl super::generated::$kernel::Choice {
            /// Choice for splats of `sh_degree`, the same on all devices.
            pub fn of_degree(sh_degree: u32) -> Self {
                let mut choice = Self::default();
                choice.spec.sh_degree = sh_degree;
                choice
            }
        }
    )*};
}

of_degree! { project project_backward adam_color }

impl Choice {
    /// Choice for a device and splats of `sh_degree`.
    pub fn prefer(caps: &Caps, sh_degree: u32) -> Choice {
        let mut choice = Choice::of_degree(sh_degree);
        if subgroups_help(caps, Variant::Subgroup.info(), Spec::default().workgroup) {
            choice.variant = Variant::Subgroup;
        }
        choice
    }

    /// Reason for that choice, one sentence.
    pub fn why(caps: &Caps) -> &'static str {
        match subgroups_help(caps, Variant::Subgroup.info(), Spec::default().workgroup) {
            true => "a subgroup sums the records of each splat with many tiles, and no lane waits for another's splat",
            false => "each invocation sums its splat's records: a processor runs one lane after the other",
        }
    }
}

impl ProjectBackward {
    /// For splats of `sh_degree` in frames with these outputs; `indexed`: slots are not in splat order.
    pub fn of_degree(gpu: &Gpu, sh_degree: u32, indexed: bool, outputs: Outputs) -> Result<ProjectBackward> {
        let mut choice = Choice::prefer(gpu.caps(), sh_degree).of_outputs(outputs);
        choice.spec.indexed = indexed.into();
        ProjectBackward::new(gpu, choice)
    }
}
