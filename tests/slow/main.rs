//! Tests that run many executions: fuzz targets of every reader.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a test that cannot go on may say so by panicking"
)]

mod fuzz;
