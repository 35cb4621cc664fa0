//! What the 3D smoothing filter of Mip-Splatting (section 5.1) makes of a splat: another splat, whose covariance
//! is the sum of its own and the filter's, and whose opacity is lowered as its density is.

use super::project_backward::{differentiate, project_backward};
use super::{Dual, Real, Splat, Viewpoint};

/// The splat convolved with a round Gaussian of standard deviation `sigma`, in world units; 0: itself.
pub fn smoothed<R: Real>(splat: &Splat<R>, sigma: f64) -> Splat<R> {
    let mut wide = splat.clone();
    if sigma == 0.0 {
        return wide;
    }
    let mut share = R::of(1.0);
    for log_scale in &mut wide.log_scale {
        let variance = log_scale.exp().squared();
        let sum = variance + R::of(sigma).squared();
        share = share * (variance / sum);
        *log_scale = R::of(0.5) * sum.ln();
    }
    let opacity = splat.opacity_logit.sigmoid() * share.sqrt();
    wide.opacity_logit = (opacity / (R::of(1.0) - opacity)).ln();
    wide
}

/// As [`project_backward`], of a splat that is smoothed before it is projected.
pub fn smoothed_backward(
    splat: &Splat<f64>,
    sigma: f64,
    view: &Viewpoint,
    by_screen: &[f64; 10],
) -> Vec<f64> {
    let by_smoothed = project_backward(&smoothed(splat, sigma), view, by_screen);
    unsmoothed(splat, sigma, &by_smoothed)
}

/// From the derivatives by the smoothed splat's parameters to those by the splat's own.
pub fn unsmoothed(splat: &Splat<f64>, sigma: f64, by_smoothed: &[f64]) -> Vec<f64> {
    differentiate(splat, |lifted| {
        let terms = smoothed(lifted, sigma).parameters().into_iter();
        terms.zip(by_smoothed).map(|(p, &d)| p * Dual::of(d)).sum()
    })
}
