//! Compute kernels: one module each, of the same name as its shader in `glsl/`.
//!
//! [`generated`] holds everything derived from the shaders: variants, tunables, parameters, bindings and the pipeline
//! type. A kernel has a file here only for host decisions: the variant for a device, or a sequence of dispatches.
//!
//! **Invariant:** no `unsafe` and no `ash` here; barriers follow from the bindings' declared access.

pub mod baseline_16x16_backward;
pub mod choices;
pub mod expand;
pub mod generated;
pub mod loss;
pub mod present;
pub mod project_backward;
pub mod rasterize;
pub mod scan;
pub mod selftest_lanes;
pub mod sort;
pub mod surface_loss;

// A module above hides the generated one of its name.
pub use generated::*;

use crate::Result;
use crate::gpu::{Caps, DeviceKind, Gpu};
use crate::shader::KernelInfo;

/// A kernel by its generated type: its variants, and compilation of one of them.
pub trait Kernel: Sized {
    /// Variant and specialisation constants.
    type Choice: Copy + std::fmt::Debug + PartialEq;
    /// Name of the shader in `glsl/`.
    const NAME: &'static str;

    /// Every variant with workgroups of so many invocations, where the size is tunable; the portable variant first.
    fn choices(workgroup: u32) -> Vec<Self::Choice>;

    /// Reflection of the chosen variant.
    fn info(choice: &Self::Choice) -> &'static KernelInfo;

    /// Creates the pipeline.
    ///
    /// # Errors
    /// Where the device cannot run the variant, or Vulkan fails.
    fn compile(gpu: &Gpu, choice: Self::Choice) -> Result<Self>;
}

/// True if lanes of full subgroups work together in `kernel`; not on processors, which run one lane after the other.
fn subgroups_help(caps: &Caps, kernel: &KernelInfo, workgroup: u32) -> bool {
    caps.kind != DeviceKind::Cpu && caps.supports(kernel).is_ok() && caps.fills_subgroups(workgroup)
}

/// Bindings of a kernel that walks the tiles' lists: lists and ellipses from a struct of buffers, then its own.
macro_rules! walker_bindings {
    ($kernel:ident, $buffers:expr, $emitted_from_isect:expr; $($own:ident: $value:expr,)*) => {
        $kernel::Bindings {
            view: &$buffers.view,
            range_from_tile: &$buffers.range_from_tile,
            emitted_from_isect: $emitted_from_isect,
            splat_from_emitted: &$buffers.splat_from_emitted,
            ellipse_from_splat: &$buffers.ellipse_from_splat,
            whiten_rg_from_splat: &$buffers.whiten_rg_from_splat,
            $($own: $value,)*
        }
    };
}
pub(crate) use walker_bindings;

/// Baselines for measurements, used by no frame and no training step. They may need features that a device lacks.
pub const BASELINES: [&str; 2] = ["baseline_16x16", "baseline_16x16_backward"];

/// Self-tests of device behaviour that the other kernels rely on, used by no frame and no training step.
pub const SELFTESTS: [&str; 5] = [
    "selftest_atomics",
    "selftest_lanes",
    "selftest_loops",
    "selftest_math",
    "selftest_progress",
];
