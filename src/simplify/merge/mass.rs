//! Splat as a Gaussian with a mass.

use super::projection::ProjectedGaussian;
use super::shadow::mean_shadow;
use crate::layout::QUATERNION_MIN;
use crate::scene::eigen;
use crate::scene::{ScreenFilter, Splats};
use glam::{DMat3, DQuat, DVec3};

/// A splat, original or merged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MassGaussian {
    pub mean: DVec3,
    pub(super) covariance: DMat3,
    /// Smallest variance along any axis, which rounding may lose beside a large one.
    pub(super) thinnest: f64,
    /// Variance added by the screen filter, world units².
    pub filter_variance: f64,
    pub(super) opacity: f64,
    /// Opacity × mean projected area: the light that it covers, averaged over all directions.
    pub mass: f64,
    /// The Gaussian as drawn, with the screen filter's variance.
    pub drawn: FilteredGaussian,
}

/// A Gaussian `amplitude · exp(−½ dᵀ covariance⁻¹ d)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct FilteredGaussian {
    amplitude: f64,
    pub covariance: DMat3,
    pub shadow: f64,
}

impl MassGaussian {
    /// Splat `index`, seen at `rate` pixels per world unit; `None` without shape or mass, or with a value that is not
    /// finite.
    pub(super) fn new(splats: &Splats, index: usize, rate: f64, filter: ScreenFilter) -> Option<MassGaussian> {
        let [w, x, y, z] = splats.quaternion[index].map(f64::from);
        let quaternion = DQuat::from_xyzw(x, y, z, w);
        let directed = quaternion.length() > f64::from(QUATERNION_MIN) && quaternion.is_finite();
        if !directed || rate.is_nan() || rate <= 0.0 {
            return None;
        }
        let rotation = DMat3::from_quat(quaternion.normalize());
        let deviations = DVec3::from(splats.log_scale[index].map(|s| f64::from(s).exp()));
        let axes = rotation * DMat3::from_diagonal(deviations);
        let variances = deviations * deviations;
        let body = MassGaussian {
            mean: DVec3::from(splats.mean[index].map(f64::from)),
            covariance: axes * axes.transpose(),
            thinnest: variances.min_element(),
            filter_variance: filter.dilation() / (rate * rate),
            opacity: (1.0 + (-f64::from(splats.opacity_logit[index])).exp()).recip(),
            mass: 0.0,
            drawn: FilteredGaussian::default(),
        };
        body.drawn_with(body.shadow(filter))
    }

    /// The splat with its mass and its Gaussian as drawn, from the `shadow` that multiplies its opacity; `None` if a
    /// value is not positive or not finite.
    pub(super) fn drawn_with(mut self, shadow: f64) -> Option<MassGaussian> {
        self.mass = self.opacity * shadow;
        self.drawn = FilteredGaussian::of(self.covariance, self.filter_variance);
        self.drawn.amplitude = self.mass / self.drawn.shadow;
        let positive = [self.mass, self.drawn.shadow, self.drawn.amplitude, self.filter_variance];
        let is_sound = positive.iter().all(|v| *v > 0.0 && v.is_finite());
        (is_sound && self.mean.is_finite() && self.covariance.is_finite()).then_some(self)
    }

    /// Mean projected area that multiplies the opacity.
    pub(super) fn shadow(&self, filter: ScreenFilter) -> f64 {
        match filter.keeps_light() {
            true => mean_shadow(eigen(self.covariance).0.max(DVec3::splat(self.thinnest))),
            false => FilteredGaussian::of(self.covariance, self.filter_variance).shadow,
        }
    }

    /// Projections of the Gaussian as drawn, at `mean`, along each of `axes`.
    pub(super) fn projections(&self, mean: DVec3, axes: &DMat3) -> [ProjectedGaussian; 3] {
        let turn = axes.transpose();
        let (covariance, mean) = (turn * self.drawn.covariance * *axes, turn * mean);
        [0, 1, 2].map(|axis| ProjectedGaussian::new(self.drawn.amplitude, &covariance, mean, axis))
    }

    /// Area of a pixel at the splat, world units².
    pub(super) fn pixel(&self, filter: ScreenFilter) -> f64 {
        self.filter_variance / filter.dilation()
    }

    /// Stores it as splat `index`, except for SH.
    pub(super) fn store(&self, splats: &mut Splats, index: usize) {
        let (variances, rotation) = eigen(self.covariance);
        let q = DQuat::from_mat3(&rotation).normalize();
        splats.mean[index] = self.mean.to_array().map(|v| v as f32);
        splats.quaternion[index] = [q.w, q.x, q.y, q.z].map(|v| v as f32);
        let log_scale = |v: f64| (0.5 * v.max(self.thinnest).max(f64::MIN_POSITIVE).ln()) as f32;
        splats.log_scale[index] = variances.to_array().map(log_scale);
        splats.opacity_logit[index] = (self.opacity / (1.0 - self.opacity)).ln() as f32;
    }
}

impl FilteredGaussian {
    fn of(covariance: DMat3, filter_variance: f64) -> FilteredGaussian {
        let covariance = covariance + DMat3::from_diagonal(DVec3::splat(filter_variance));
        let variances = eigen(covariance).0.max(DVec3::splat(filter_variance));
        FilteredGaussian {
            amplitude: 0.0,
            covariance,
            shadow: mean_shadow(variances),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::shadow::square;
    use super::*;
    use crate::layout::ALPHA_MAX;
    use crate::train::rng::{self, Stream};

    /// Scene of a single splat.
    fn splat(mean: [f32; 3], quaternion: [f32; 4], log_scale: [f32; 3], opacity_logit: f32) -> Splats {
        Splats {
            mean: vec![mean],
            quaternion: vec![quaternion],
            log_scale: vec![log_scale],
            opacity_logit: vec![opacity_logit],
            sh: vec![0.0; 3],
            ..Splats::default()
        }
    }

    fn random(i: u32, spread: f32) -> MassGaussian {
        let [x, y, z, w] = rng::uniform(1, 0, i, Stream::RandomInit);
        let [a, b, c, d] = rng::uniform(2, 0, i, Stream::RandomInit);
        let quaternion = [a - 0.5, b - 0.5, c - 0.5, d - 0.4];
        let log_scale = [3.0 * a - 3.0, 3.0 * c - 3.0, 3.0 * d - 3.0];
        let mean = [x, y, z].map(|v| spread * v);
        MassGaussian::new(
            &splat(mean, quaternion, log_scale, 6.0 * w - 4.0),
            0,
            30.0,
            ScreenFilter::Classic,
        )
        .unwrap()
    }

    /// Mass, first and second moments about the world's origin.
    fn moments(mass: f64, mean: DVec3, covariance: DMat3) -> [DMat3; 3] {
        [
            DMat3::from_diagonal(DVec3::splat(mass)),
            DMat3::from_diagonal(mass * mean),
            (covariance + square(mean)) * mass,
        ]
    }

    #[test]
    fn moments_of_what_both_cover_are_those_of_the_merged() {
        for (spread, capped) in [(1.0, true), (4.0, true), (400.0, false)] {
            let mut tested = 0;
            for i in 0..200 {
                let (a, b) = (random(2 * i, spread), random(2 * i + 1, spread));
                let (merged, joint) = a.merged(&b, ScreenFilter::Classic).unwrap();
                let common_mean = a.mean + joint.common_offset;
                let filter_variance = DMat3::from_diagonal(DVec3::splat(merged.filter_variance));
                let parts = [
                    moments(a.mass, a.mean, a.covariance),
                    moments(b.mass, b.mean, b.covariance),
                    moments(-joint.mass, common_mean, joint.covariance - filter_variance),
                ];
                let full = a.mass + b.mass - joint.mass;
                if merged.opacity >= f64::from(ALPHA_MAX) {
                    assert!(capped && merged.mass <= full * (1.0 + 1e-12));
                    continue;
                }
                assert!((merged.mass / full - 1.0).abs() < 1e-14);
                tested += 1;
                let found = moments(full, merged.mean, merged.covariance);
                for (order, found) in found.into_iter().enumerate() {
                    let wanted = parts[0][order] + parts[1][order] + parts[2][order];
                    // A few dozen roundings of numbers of this size: masses times squares of coordinates.
                    let size = (a.mass + b.mass) * (f64::from(spread) + 2.0).powi(order as i32);
                    let off = (found - wanted).to_cols_array().map(f64::abs);
                    assert!(off.iter().all(|&x| x < 64.0 * f64::EPSILON * size), "{i}: {off:?}");
                }
                if !capped {
                    assert!(joint.mass < 1e-3 * full, "so far apart they have nothing in common");
                    assert!((joint.share - b.mass / full).abs() < 1e-3);
                }
            }
            assert!(tested > 50, "{tested}");
        }
    }

    /// 1 − (1 − α G)², with 2 α − α² / 2 of the light of one (M19 without its order).
    #[test]
    fn of_two_in_one_place_the_one_behind_is_covered() {
        for logit in [-3.0, 0.0, 1.0, 6.0] {
            let one = splat([1.0, 2.0, 3.0], [0.3, 0.1, -0.2, 0.9], [-1.0, -1.5, -0.5], logit);
            let body = MassGaussian::new(&one, 0, 1e6, ScreenFilter::Classic).unwrap();
            let (merged, joint) = body.merged(&body, ScreenFilter::Classic).unwrap();
            let alpha = body.opacity;
            let share = merged.mass / body.mass;
            assert!((share - (2.0 - alpha / 2.0)).abs() < 1e-6, "{alpha}: {share}");
            assert!((merged.mean - body.mean).length() < 1e-14);
            assert!((joint.share - 0.5).abs() < 1e-15);
            // A flatter top: wider than either, of the same shape.
            let ratio = merged.covariance.determinant() / body.covariance.determinant();
            assert!(ratio > 1.0 && ratio < 4.0, "{ratio}");
            assert!(merged.opacity > alpha.min(0.99) && merged.opacity < 2.0 * alpha);
        }
    }

    #[test]
    fn what_is_written_has_the_merged_shape() {
        let shapes = [
            [0.0, 0.0, 0.0],
            [1.0, -12.0, -12.0],
            [0.5, 0.5, -12.0],
            [-20.0, -20.0, -20.0],
            [12.0, 11.0, -3.0],
        ];
        for (i, shape) in shapes.into_iter().enumerate() {
            let other = shapes[(i + 1) % shapes.len()];
            for other in [shape, other] {
                let a = splat([0.1, 0.2, 0.3], [0.3, 0.1, -0.2, 0.9], shape, 2.0);
                let b = splat([0.1, 0.21, 0.3], [0.3, 0.1, -0.2, 0.9], other, 20.0);
                let [one, two] = [&a, &b].map(|s| MassGaussian::new(s, 0, 100.0, ScreenFilter::Classic).unwrap());
                let (merged, _) = one.merged(&two, ScreenFilter::Classic).unwrap();
                let mut written = a.clone();
                merged.store(&mut written, 0);
                assert_eq!(written.not_finite(), None, "{shape:?}");
                let length: f32 = written.quaternion[0].iter().map(|q| q * q).sum();
                assert!((length - 1.0).abs() < 1e-6);
                let read = MassGaussian::new(&written, 0, 100.0, ScreenFilter::Classic).unwrap();
                let off = (read.covariance - merged.covariance).to_cols_array();
                let largest = merged.covariance.col(0)[0] + merged.covariance.col(1)[1] + merged.covariance.col(2)[2];
                // Two roundings of 2⁻²⁴ of a logarithm of up to 20, four of a quaternion.
                assert!(off.iter().all(|x| x.abs() < 1e-5 * largest), "{shape:?}: {off:?}");
                assert!((read.opacity - merged.opacity).abs() < 1e-5);
            }
        }
    }
}
