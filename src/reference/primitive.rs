//! Everything that depends on the kind of splat: exponent, extent, depth. A 3D Gaussian has its ellipse on the screen,
//! a surfel the hits of the pixels' rays. Derivatives follow from duals.

use super::project::determinant;
use super::surfel;
use super::{Real, ScreenSplat, Thresholds};

/// Half the squared Mahalanobis distance of a position (pixels) from the splat's mean: `½ dᵀ Σ⁻¹ d`, or that of the hit
/// of a surfel.
pub fn power<R: Real>(splat: &ScreenSplat<R>, position: [f64; 2]) -> R {
    if let Some(disc) = &splat.disc {
        return surfel::power(disc, splat.mean, splat.covariance, position);
    }
    let dx = R::of(position[0]) - splat.mean[0];
    let dy = R::of(position[1]) - splat.mean[1];
    let [xx, xy, yy] = splat.covariance;
    let two = R::of(2.0);
    (yy * dx * dx - two * xy * dx * dy + xx * dy * dy) / (two * determinant(splat.covariance))
}

/// Minimum of [`power`] over a rectangle of positions, from the first to the second of `x` and of `y`, of a 3D
/// Gaussian.
pub fn power_min(splat: &ScreenSplat<f64>, x: [f64; 2], y: [f64; 2]) -> f64 {
    let [mean_x, mean_y] = splat.mean;
    if (x[0]..=x[1]).contains(&mean_x) && (y[0]..=y[1]).contains(&mean_y) {
        return 0.0;
    }
    // The form is convex: outside its minimum it is least on the border, and on a line it is a parabola with its
    // minimum at the conditional mean.
    let [xx, xy, yy] = splat.covariance;
    let mut least = f64::INFINITY;
    for edge in x {
        // x = edge: over y, the parabola is lowest at mean_y + xy / xx (x − mean_x).
        let y = (mean_y + xy / xx * (edge - mean_x)).clamp(y[0], y[1]);
        least = least.min(power(splat, [edge, y]));
    }
    for edge in y {
        let x = (mean_x + xy / yy * (edge - mean_y)).clamp(x[0], x[1]);
        least = least.min(power(splat, [x, edge]));
    }
    least
}

/// Half width and half height, in pixels, of the box around the ellipse above the alpha threshold; 0 if the splat is
/// below it everywhere.
pub fn extent(splat: &ScreenSplat<f64>, thresholds: &Thresholds) -> [f64; 2] {
    // opacity · exp(−r² / 2) = alpha_min at the squared Mahalanobis radius r², and an ellipse extends along an axis by
    // r times its standard deviation.
    let squared_radius = 2.0 * (splat.opacity / thresholds.alpha_min).ln();
    let [xx, _, yy] = splat.covariance;
    [xx, yy].map(|variance| (squared_radius.max(0.0) * variance).sqrt())
}

/// Depth at a position: that of the mean.
pub fn depth<R: Real>(splat: &ScreenSplat<R>) -> R {
    splat.depth
}
