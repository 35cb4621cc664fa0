//! A run of `ashfall bench kernels` as one JSON object.

use super::{Ratio, TARGET_FEATURES};
use crate::lab::bench::{Bench, Row};
use serde::Serialize;

/// What was measured, on what.
#[derive(Debug, Serialize)]
pub struct KernelReport<'a> {
    /// The device.
    pub device: &'a str,
    /// Its driver.
    pub driver: &'a str,
    /// What the compiler was allowed to use of the processor.
    pub target_features: &'static str,
    /// All measurements.
    pub rows: &'a [Row],
    /// Comparisons within this run.
    pub ratios: &'a [Ratio],
}

impl<'a> KernelReport<'a> {
    /// All that a bench has, and its comparisons.
    pub fn of(bench: &'a Bench, ratios: &'a [Ratio]) -> KernelReport<'a> {
        let caps = bench.gpu().caps();
        KernelReport {
            device: &caps.name,
            driver: &caps.driver,
            target_features: TARGET_FEATURES,
            rows: bench.rows(),
            ratios,
        }
    }
}
