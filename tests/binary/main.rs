//! Tests of the `ashfall` executable.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a test that cannot go on may say so by panicking"
)]

#[path = "../common/mod.rs"]
mod common;

mod bench;
mod broken;
mod capi;
mod capture_faults;
mod capture_lists;
mod captures;
mod cli;
mod growth;
mod package;
mod predict;
mod stress;
mod tools;
#[cfg(feature = "window")]
mod window;
