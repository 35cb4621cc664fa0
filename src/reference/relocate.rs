//! Opacity and scale of `n` copies that replace a splat without a change of the picture (3DGS-MCMC, Kheradmand et al.
//! 2024, equation 9).
//!
//! The paper's denominator is a double alternating sum over binomials. With `1/√(k+1)` written as a Gaussian integral
//! it collapses to `1/√π ∫ 1 − (1 − α e^{−u²})ⁿ du`. The integrand lies between 0 and 1: no cancellation for any `n`.

use std::f64::consts::PI;

/// Opacity of each of `n` copies: `1 − (1 − opacity)^(1/n)`. The opacity must be below 1.
pub fn opacity(opacity: f64, n: u32) -> f64 {
    assert!((0.0..1.0).contains(&opacity) && n > 0, "opacity {opacity}, {n} copies");
    -f64::exp_m1(f64::ln_1p(-opacity) / f64::from(n))
}

/// Factor on the scales of each of `n` copies.
pub fn scale_factor(opacity: f64, n: u32) -> f64 {
    let copy = self::opacity(opacity, n);
    // The trapezoidal rule converges exponentially here; the tails beyond |u| = 7 are below n e^−49.
    const STEPS_PER_UNIT: i32 = 64;
    let mut integral = 0.0;
    for step in -7 * STEPS_PER_UNIT..=7 * STEPS_PER_UNIT {
        let u = f64::from(step) / f64::from(STEPS_PER_UNIT);
        let alpha = copy * (-u * u).exp();
        integral -= f64::exp_m1(f64::from(n) * f64::ln_1p(-alpha)) / f64::from(STEPS_PER_UNIT);
    }
    opacity / (integral / PI.sqrt())
}
