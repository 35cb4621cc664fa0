//! Compute kernels: one module each, of the same name as its shader in `glsl/`.
//!
//! [`generated`] holds everything derived from the shaders: variants, tunables, parameters, bindings and the pipeline
//! type. A kernel has a file here only for host decisions: the variant for a device, or a sequence of dispatches.
//!
//! **Invariant:** no `unsafe` and no `ash` here; barriers follow from the bindings' declared access.

pub mod baseline_16x16_backward;
pub mod choices;
pub mod generated;
pub mod present;
pub mod project;
pub mod project_backward;
pub mod rasterize;
pub mod rasterize_inria;
pub mod scan;
pub mod selftest_lanes;
pub mod sort;

// A module above hides the generated one of its name.
pub use generated::*;

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
