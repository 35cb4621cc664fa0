//! Tests on a Vulkan device: kernels, frames, gradients, training, failures, embedding.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a test that cannot go on may say so by panicking"
)]

#[path = "../common/mod.rs"]
mod common;

mod embed;
mod faults;
mod frame;
mod gpu;
mod gradients;
mod instances;
mod kernels;
mod large;
mod memory;
mod meshes;
mod ordering;
mod orthographic;
mod picking;
mod poses;
mod refinement;
mod row_bands;
mod simplify;
mod stability;
mod surfaces;
mod surfels;
