//! Gradient of every parameter of every splat, from the records of compositing.

pub use super::generated::project_backward::*;
use super::rasterize::Outputs;
use crate::Result;
use crate::gpu::Gpu;

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

of_degree! { project project_backward adam_color pose_gradient }

impl ProjectBackward {
    /// One for splats of each degree up to `highest`, for frames with these outputs; `indexed`: slots are not in splat
    /// order.
    pub fn of_degrees(gpu: &Gpu, highest: u32, indexed: bool, outputs: Outputs) -> Result<Vec<ProjectBackward>> {
        let kernel = |degree| {
            let mut choice = Choice::of_degree(degree).of_outputs(outputs);
            choice.spec.indexed = indexed.into();
            ProjectBackward::new(gpu, choice)
        };
        (0..=highest).map(kernel).collect()
    }
}
