//! Tests without a device: sources, file formats, the f64 reference and the build script.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a test that cannot go on may say so by panicking"
)]

#[path = "../common/mod.rs"]
mod common;

mod build_script;
mod dependencies;
mod header;
mod io;
mod mesh;
mod mesh_align;
mod mesh_colors;
mod mesh_smooth;
mod noise;
mod reference;
mod synth;
mod tidy;
