//! Tests that run many executions, or other programs: fuzz targets of every reader, clients of formats.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a test that cannot go on may say so by panicking"
)]

mod clients;
mod fuzz;
