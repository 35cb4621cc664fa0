//! The operations: one file each, of the same name as its shader in `glsl/`.
//!
//! [`generated`] holds what follows from the shaders alone: variants, tunables, parameters, bindings and
//! a wrapper per kernel. A file here adds what a host has to decide: which variant suits a device, how
//! many groups there are.
//!
//! **Invariant:** no `unsafe` and no `ash` here; barriers follow from the bindings' declared access.

pub mod adam;
pub mod baseline_16x16;
pub mod baseline_16x16_backward;
pub mod choices;
pub mod compact;
pub mod contribution;
pub mod expand;
pub mod gather;
pub mod generated;
pub mod loss;
pub mod loss_backward;
pub mod loss_sum;
pub mod perturb;
pub mod plan;
pub mod present;
pub mod project;
pub mod project_backward;
pub mod prune_limit;
pub mod ranges;
pub mod rasterize;
pub mod rasterize_backward;
pub mod rasterize_inria;
pub mod removal_error;
pub mod scan;
pub mod scan_apply;
pub mod scan_chunks;
pub mod scan_reduce;
pub mod selftest_atomics;
pub mod selftest_lanes;
pub mod selftest_loops;
pub mod selftest_math;
pub mod selftest_progress;
pub mod sort;
pub mod sort_count;
pub mod sort_scatter;
pub mod sum_by_splat;

pub use generated::KERNELS;

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
