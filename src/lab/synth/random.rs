//! Random numbers keyed by their purpose, independent of the order of threads.

use crate::stats::SplitMix64;
use glam::DVec3;

/// A short stream of numbers, a pure function of `seed` and `key`.
pub(super) struct KeyedRandom(SplitMix64);

impl KeyedRandom {
    /// The stream of item `key` under `seed`.
    pub(super) fn new(seed: u64, key: u64) -> KeyedRandom {
        // One round first, so that neighbouring seeds and keys do not share streams.
        let mixed = SplitMix64(seed).bits();
        KeyedRandom(SplitMix64(mixed ^ key.wrapping_mul(0xd1b5_4a32_d192_ed03)))
    }

    /// Uniform in 0 to 1, 1 excluded.
    pub(super) fn uniform(&mut self) -> f64 {
        self.0.unit()
    }

    /// Uniform in `low..high`.
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Uniform in `0..count`.
    pub(super) fn index(&mut self, count: usize) -> usize {
        (self.uniform() * count as f64) as usize
    }

    /// Uniform on the unit sphere.
    pub(super) fn direction(&mut self) -> DVec3 {
        let z = self.between(-1.0, 1.0);
        let (y, x) = self.between(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * x, r * y, z)
    }

    /// Normally distributed with mean 0 and deviation 1 (Box and Muller).
    pub(super) fn normal(&mut self) -> f64 {
        let r = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        r * self.between(0.0, std::f64::consts::TAU).cos()
    }
}
