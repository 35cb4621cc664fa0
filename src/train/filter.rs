//! 3D smoothing filter of one splat: its effect on scales and opacity.

use crate::scene::Primitive;

/// Least logit that [`baked`] returns: an opacity of 1e-35, as invisible as 0, for which the logit would not be finite.
pub(super) const LOGIT_MIN: f64 = -80.0;

/// ln(1 + eˣ), without overflow.
fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// Increase of each log-scale: ½ ln(1 + (σ / s)²). Products of squared scales would leave the range of floats in scenes
/// of small units; logarithms of ratios do not. Surfels are filtered in their planes: the third scale stays.
fn growth(log_scale: [f32; 3], sigma: f32, primitive: Primitive) -> [f64; 3] {
    let filtered = sigma > 0.0 && sigma.is_finite();
    let log_sigma = f64::from(sigma).ln();
    [0, 1, 2].map(|axis| match filtered && axis < primitive.scale_count() {
        true => 0.5 * softplus(2.0 * (log_sigma - f64::from(log_scale[axis]))),
        false => 0.0,
    })
}

/// Factor of the filter on the opacity: √(Π s² / Π (s² + σ²)).
pub fn opacity_factor(log_scale: [f32; 3], sigma: f32, primitive: Primitive) -> f64 {
    (-growth(log_scale, sigma, primitive).iter().sum::<f64>()).exp()
}

/// Log-scales and opacity logit of a splat with the filter of standard deviation `sigma` baked in; unchanged if there
/// is none.
pub fn baked(log_scale: [f32; 3], opacity_logit: f32, sigma: f32, primitive: Primitive) -> ([f32; 3], f32) {
    let growth = growth(log_scale, sigma, primitive);
    let log_factor = -growth.iter().sum::<f64>();
    if log_factor == 0.0 {
        return (log_scale, opacity_logit);
    }
    let wider = [0, 1, 2].map(|axis| (f64::from(log_scale[axis]) + growth[axis]) as f32);
    // With opacity o and factor c, 1 - o c = (1 - o) + o (1 - c), without cancellation.
    let u = f64::from(opacity_logit);
    let (log_opacity, rest) = (-softplus(-u), (-softplus(u)).exp());
    let without = rest + log_opacity.exp() * -log_factor.exp_m1();
    let logit = log_opacity + log_factor - without.ln();
    // Not `max`, which would replace NaN by a number.
    let logit = if logit < LOGIT_MIN { LOGIT_MIN } else { logit };
    (wider, logit as f32)
}
