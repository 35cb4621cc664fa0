//! Orthographic projection of a Gaussian along a coordinate axis.

use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// `amplitude · exp(−½ dᵀ covariance⁻¹ d)` over a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ProjectedGaussian {
    amplitude: f64,
    /// xx, xy, yy.
    covariance: [f64; 3],
    mean: [f64; 2],
}

impl ProjectedGaussian {
    /// Projection of a Gaussian along an axis.
    pub(super) fn new(amplitude: f64, covariance: &DMat3, mean: DVec3, axis: usize) -> ProjectedGaussian {
        let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
        let c = covariance;
        ProjectedGaussian {
            amplitude,
            covariance: [c.col(x)[x], c.col(x)[y], c.col(y)[y]],
            mean: [mean[x], mean[y]],
        }
    }

    /// Product of two, again a Gaussian.
    pub(super) fn times(&self, other: &ProjectedGaussian) -> ProjectedGaussian {
        let ([a, b, c], [d, e, f]) = (self.covariance, other.covariance);
        let [xx, xy, yy] = [a + d, b + e, c + f];
        let determinant = xx * yy - xy * xy;
        let offset = [0, 1].map(|k| other.mean[k] - self.mean[k]);
        // Covariance of the sum, inverted, times the offset.
        let pull = [
            (yy * offset[0] - xy * offset[1]) / determinant,
            (xx * offset[1] - xy * offset[0]) / determinant,
        ];
        let distance = offset[0] * pull[0] + offset[1] * pull[1];
        // A (A + B)⁻¹ B = (|B| A + |A| B) / |A + B| in a plane.
        let [mine, others] = [self.determinant(), other.determinant()];
        let mix = |a: f64, b: f64| (others * a + mine * b) / determinant;
        ProjectedGaussian {
            amplitude: self.amplitude * other.amplitude * (-0.5 * distance).exp(),
            covariance: [mix(a, d), mix(b, e), mix(c, f)],
            mean: [
                self.mean[0] + a * pull[0] + b * pull[1],
                self.mean[1] + b * pull[0] + c * pull[1],
            ],
        }
    }

    fn determinant(&self) -> f64 {
        let [xx, xy, yy] = self.covariance;
        (xx * yy - xy * xy).max(0.0)
    }

    /// Value at a point.
    #[cfg(test)]
    pub(super) fn value(&self, at: [f64; 2]) -> f64 {
        let [xx, xy, yy] = self.covariance;
        let [x, y] = [at[0] - self.mean[0], at[1] - self.mean[1]];
        let square = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / self.determinant();
        self.amplitude * (-0.5 * square).exp()
    }

    /// Integral over the plane.
    pub(super) fn light(&self) -> f64 {
        TAU * self.amplitude * self.determinant().sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_is_the_product_at_every_point_and_its_light_the_sum_of_them() {
        let a = ProjectedGaussian {
            amplitude: 0.8,
            covariance: [1.0, 0.4, 0.7],
            mean: [0.3, -0.2],
        };
        let b = ProjectedGaussian {
            amplitude: 0.5,
            covariance: [0.3, -0.1, 1.5],
            mean: [-0.6, 0.5],
        };
        let product = a.times(&b);
        let (step, mut sum) = (0.05, 0.0);
        for i in -160..160 {
            for k in -160..160 {
                let at = [step * f64::from(i), step * f64::from(k)];
                let wanted = a.value(at) * b.value(at);
                assert!((product.value(at) - wanted).abs() < 1e-14, "{at:?}");
                sum += wanted * step * step;
            }
        }
        // The trapezoidal rule on a Gaussian is exact to rounding at this step.
        assert!((product.light() - sum).abs() < 1e-12, "{sum}");
        let other_way = b.times(&a);
        assert!((other_way.light() - sum).abs() < 1e-12);
    }
}
