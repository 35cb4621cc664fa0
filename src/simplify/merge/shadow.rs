//! Mean projected areas of Gaussians.

use glam::{DMat3, DVec3};

/// Exponent of Thomsen's formula.
const THOMSEN: f64 = 1.6075;

/// Mean over all directions of the product of the two standard deviations of a projected Gaussian, from the variances
/// along its axes; s² for a round one. By Cauchy's theorem the mean projection of a convex body is a quarter of its
/// surface, which Thomsen's formula gives for an ellipsoid to 1.1 %.
pub(super) fn mean_shadow(variances: DVec3) -> f64 {
    let v = variances.max(DVec3::ZERO);
    let power = |product: f64| product.powf(0.5 * THOMSEN);
    let mean = (power(v.x * v.y) + power(v.x * v.z) + power(v.y * v.z)) / 3.0;
    mean.powf(1.0 / THOMSEN)
}

/// v vᵀ.
pub(super) fn square(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against quadrature over directions.
    #[test]
    fn a_mean_shadow_is_that_over_all_directions() {
        for shape in [[1.0, 1.0, 1.0], [9.0, 4.0, 1.0], [4.0, 4.0, 1e-6], [100.0, 1.0, 1.0]] {
            let [a, b, c] = shape;
            let (steps, mut sum) = (400, 0.0);
            for i in 0..steps {
                let z = -1.0 + (2.0 * f64::from(i) + 1.0) / f64::from(steps);
                for k in 0..steps {
                    let angle = std::f64::consts::TAU * f64::from(k) / f64::from(steps);
                    let (x, y) = ((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin());
                    // The projection along a unit vector u has the determinant uᵀ adj(Σ) u.
                    sum += (b * c * x * x + a * c * y * y + a * b * z * z).sqrt();
                }
            }
            let mean = sum / f64::from(steps * steps);
            let shadow = mean_shadow(DVec3::from(shape));
            assert!((shadow / mean - 1.0).abs() < 0.012, "{shape:?}: {shadow}, {mean}");
        }
    }
}
