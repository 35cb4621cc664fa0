//! A run of `ashfall bench kernels` as one JSON object.

use super::{Ratio, TARGET_FEATURES};
use crate::lab::bench::{Bench, BenchRow};
use serde::Serialize;

/// Device, rows and ratios of one run.
#[derive(Debug, Serialize)]
pub struct KernelReport<'a> {
    /// The device.
    pub device: &'a str,
    /// Its driver.
    pub driver: &'a str,
    /// Vector instructions that the compiler was allowed to use.
    pub target_features: &'static str,
    /// All measurements.
    pub rows: &'a [BenchRow],
    /// Comparisons with the baselines.
    pub ratios: &'a [Ratio],
}

impl<'a> KernelReport<'a> {
    /// All rows of a bench, and its comparisons.
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
