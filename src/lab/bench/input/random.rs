//! Reproducible random numbers, exact in `f32`.

use crate::stats::SplitMix64;

/// A small deterministic generator.
#[derive(Clone, Debug)]
pub struct Random(SplitMix64);

impl Random {
    /// Generator of a seed.
    pub fn new(seed: u64) -> Random {
        Random(SplitMix64(
            seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d,
        ))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// Uniform below `count`, which must be positive.
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// Uniform in `[low, high)`, exact in `f32`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        single(low + (high - low) * self.0.unit())
    }

    /// Uniform in logarithm.
    pub fn log_between(&mut self, low: f64, high: f64) -> f64 {
        single(self.between(low.ln(), high.ln()).exp())
    }

    /// Standard normal, exact in `f32`.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.between(0.0, 1.0)).max(1e-12).ln()).sqrt();
        single(radius * self.between(0.0, std::f64::consts::TAU).cos())
    }

    /// Shuffled indices.
    pub fn permutation(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for i in (1..count).rev() {
            order.swap(i, self.below(i + 1));
        }
        order
    }
}

/// The nearest `f32` value.
pub fn single(x: f64) -> f64 {
    f64::from(x as f32)
}
