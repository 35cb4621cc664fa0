//! Exploration noise of 3DGS-MCMC (Kheradmand et al. 2024, equation 9 and its code), with its random numbers.

use super::Real;
use super::dropout::pcg;
use super::linear::{add, covariance, scale, transform};
use std::f64::consts::TAU;

/// Opacity of half the maximum noise.
pub const OPACITY_MIDDLE: f64 = 0.005;
/// Steepness of the fade with opacity.
pub const OPACITY_STEEPNESS: f64 = 100.0;

/// The mean moved by `Σ ξ · sigmoid(−100 (opacity − 0.005)) · strength`. `xi` are three standard normal
/// numbers; `strength` is the learning rate of means times 5e5 (world units⁻¹).
pub fn perturb(
    mean: [f64; 3],
    quaternion: [f64; 4],
    log_scale: [f64; 3],
    opacity_logit: f64,
    xi: [f64; 3],
    strength: f64,
) -> [f64; 3] {
    let gate = (-OPACITY_STEEPNESS * (opacity_logit.sigmoid() - OPACITY_MIDDLE)).sigmoid();
    let noise = transform(covariance(quaternion, log_scale), xi);
    add(mean, scale(gate * strength, noise))
}

/// Three standard normal numbers of a splat in a step: Box–Muller over the uniforms of draws 0 to 3.
pub fn normals(seed: u32, step: u32, splat: u32) -> [f64; 3] {
    let u = [0, 1, 2, 3].map(|draw| uniform(seed, step, splat, draw));
    let radius = |u: f64| (-2.0 * u.ln()).sqrt();
    let (first, second) = (radius(u[0]), radius(u[2]));
    [
        first * (TAU * u[1]).cos(),
        first * (TAU * u[1]).sin(),
        second * (TAU * u[3]).cos(),
    ]
}

/// A number in (0, 1) as a function of the four arguments alone: 23 bits, hashed one into the other, and a half, so
/// that 0 and 1 never occur.
pub fn uniform(seed: u32, step: u32, splat: u32, draw: u32) -> f64 {
    let word = [step, splat, draw]
        .iter()
        .fold(pcg(seed), |hash, number| pcg(hash ^ number));
    (f64::from(word >> 9) + 0.5) / f64::from(1 << 23)
}
