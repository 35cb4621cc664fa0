//! The operations: one module each, of the same name as its shader in `glsl/`.
//!
//! [`generated`] holds all that follows from the shaders alone: variants, tunables, parameters, bindings and the type
//! that is dispatched. A kernel has a file here only where a host has something to decide: the variant that suits a
//! device, or a sequence of dispatches.
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

/// Kernels that no frame and no training step runs: what the others are measured against. They may need what
/// a device does not have to offer.
pub const BASELINES: [&str; 2] = ["baseline_16x16", "baseline_16x16_backward"];

/// Kernels that no frame and no training step runs either: they ask whether a device does what the others rely on.
pub const SELFTESTS: [&str; 5] = [
    "selftest_atomics",
    "selftest_lanes",
    "selftest_loops",
    "selftest_math",
    "selftest_progress",
];
