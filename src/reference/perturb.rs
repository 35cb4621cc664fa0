//! The exploration noise of 3DGS-MCMC (Kheradmand et al. 2024, equation 8 and its code).

use super::Real;
use super::linear::{add, covariance, scale, transform};

/// Opacity at which the noise is half as strong as at its most.
pub const OPACITY_MIDDLE: f64 = 0.005;
/// How steeply the noise fades with the opacity.
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
