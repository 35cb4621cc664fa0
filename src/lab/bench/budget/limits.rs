//! Limits of devices, from their makers' data sheets.

use serde::Serialize;

/// Rates of a device by its maker's data sheet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PublishedLimits {
    /// Name on the command line.
    pub name: &'static str,
    /// Name of the product.
    pub product: &'static str,
    /// Rate of the memory, bytes per second.
    pub bytes_per_s: f64,
    /// Rate of single precision without matrix units, operations per second; a fused multiply-add is two.
    pub operations_per_s: f64,
}

/// Devices with known limits.
pub const PUBLISHED: [PublishedLimits; 6] = [
    of("h100", "NVIDIA H100 SXM", 3_350.0, 67.0),
    of("h200", "NVIDIA H200 SXM", 4_800.0, 67.0),
    of("a100", "NVIDIA A100 80GB SXM", 2_039.0, 19.5),
    of("rtx4090", "NVIDIA GeForce RTX 4090", 1_008.0, 82.6),
    of("rtx3090", "NVIDIA GeForce RTX 3090", 936.0, 35.6),
    of("rx7900xtx", "AMD Radeon RX 7900 XTX", 960.0, 61.4),
];

const fn of(
    name: &'static str,
    product: &'static str,
    gigabytes_per_s: f64,
    teraoperations_per_s: f64,
) -> PublishedLimits {
    PublishedLimits {
        name,
        product,
        bytes_per_s: 1e9 * gigabytes_per_s,
        operations_per_s: 1e12 * teraoperations_per_s,
    }
}

impl PublishedLimits {
    /// Limits of a name in [`PUBLISHED`].
    pub fn named(name: &str) -> Option<PublishedLimits> {
        PUBLISHED.into_iter().find(|limits| limits.name == name)
    }
}
