//! 3D smoothing filter of Mip-Splatting (section 5.1): the smoothed splat has the sum of its own covariance and the
//! filter's, and an opacity lowered like its density. Surfels are smoothed in their planes.

use super::project_backward::{differentiate, project_backward};
use super::{Dual, Real, Splat, Viewpoint};
use crate::scene::Primitive;

/// The splat convolved with a round Gaussian of standard deviation `sigma`, in world units; 0: unchanged.
pub fn smoothed<R: Real>(splat: &Splat<R>, sigma: f64) -> Splat<R> {
    smoothed_along(splat, sigma, Primitive::Gaussian3d)
}

/// The same along the axes of a kind of splat.
pub fn smoothed_along<R: Real>(splat: &Splat<R>, sigma: f64, primitive: Primitive) -> Splat<R> {
    let mut wide = splat.clone();
    if sigma == 0.0 {
        return wide;
    }
    let mut share = R::of(1.0);
    for log_scale in wide.log_scale.iter_mut().take(primitive.scale_count()) {
        let variance = log_scale.exp().squared();
        let sum = variance + R::of(sigma).squared();
        share = share * (variance / sum);
        *log_scale = R::of(0.5) * sum.ln();
    }
    let opacity = splat.opacity_logit.sigmoid() * share.sqrt();
    wide.opacity_logit = (opacity / (R::of(1.0) - opacity)).ln();
    wide
}

/// [`project_backward`] of a splat that is smoothed before projection.
pub fn smoothed_backward(splat: &Splat<f64>, sigma: f64, view: &Viewpoint, by_screen: &[f64; 10]) -> Vec<f64> {
    let by_smoothed = project_backward(&smoothed(splat, sigma), view, by_screen);
    unsmoothed(splat, sigma, &by_smoothed)
}

/// Derivatives by the splat's parameters from those by the smoothed splat's.
pub fn unsmoothed(splat: &Splat<f64>, sigma: f64, by_smoothed: &[f64]) -> Vec<f64> {
    unsmoothed_along(splat, sigma, by_smoothed, Primitive::Gaussian3d)
}

/// The same along the axes of a kind of splat.
pub fn unsmoothed_along(splat: &Splat<f64>, sigma: f64, by_smoothed: &[f64], primitive: Primitive) -> Vec<f64> {
    differentiate(splat, |lifted| {
        let terms = smoothed_along(lifted, sigma, primitive).parameters().into_iter();
        terms.zip(by_smoothed).map(|(p, &d)| p * Dual::of(d)).sum()
    })
}
