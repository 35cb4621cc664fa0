//! Merge of two splats, and their overlap averaged over viewing directions.

use super::mass::MassGaussian;
use super::shadow::{mean_shadow, square};
use crate::layout::ALPHA_MAX;
use crate::scene::ScreenFilter;
use crate::scene::eigen;
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Overlap of two splats: 1 − (1 − α G) (1 − α′ G′) = α G + α′ G′ − α α′ G G′ is the cover of both, and a product of
/// Gaussians is a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Joint {
    /// From the first mean to the second.
    pub offset: DVec3,
    /// Principal axes of their mixture, used as viewing directions.
    pub axes: DMat3,
    /// Weight of the view along each axis, sum 1: the share of directions like it, those with sines small beside the
    /// ratio of deviations. Most views of a disc are along its axis, hardly any of a needle.
    pub views: DVec3,
    /// Second splat's share of the colour: each is in front in half of the views.
    pub share: f64,
    /// Mass of the overlap: as large a part of the mixture's as in the three views.
    pub mass: f64,
    /// Covariance of G G′.
    pub covariance: DMat3,
    /// From the first mean to that of G G′.
    pub common_offset: DVec3,
}

impl Joint {
    pub(super) fn of(a: &MassGaussian, b: &MassGaussian) -> Joint {
        let offset = b.mean - a.mean;
        let (first, second) = (&a.drawn, &b.drawn);
        let share = b.mass / (a.mass + b.mass);
        let mixture =
            first.covariance * (1.0 - share) + second.covariance * share + square(offset) * (share * (1.0 - share));
        let (variances, axes) = eigen(mixture);
        let variances = variances.max(DVec3::splat(a.filter_variance.min(b.filter_variance)));
        let inverse = variances.recip();
        let views = inverse / inverse.element_sum();
        let [one, other] = [a.projections(DVec3::ZERO, &axes), b.projections(offset, &axes)];
        let deviations = variances.map(f64::sqrt);
        let filled = |axis: usize| {
            let light = one[axis].times(&other[axis]).light() / TAU;
            views[axis] * light * deviations[axis] / deviations.element_product()
        };
        let common = mean_shadow(variances) * (0..3).map(filled).sum::<f64>();
        // At most the mass of either.
        let mass = common.min(a.mass).min(b.mass);
        let inverse = (first.covariance + second.covariance).inverse();
        let product = first.covariance * inverse * second.covariance;
        Joint {
            offset,
            axes,
            views,
            share: (b.mass - 0.5 * mass) / (a.mass + b.mass - mass),
            mass,
            covariance: (product + product.transpose()) * 0.5,
            common_offset: first.covariance * (inverse * offset),
        }
    }
}

impl MassGaussian {
    /// Merged splat and overlap: the mass, mean and covariance of the mixture, and the opacity for that mass, or an
    /// opaque and larger splat if none suffices. `None` if a value leaves its range.
    pub(super) fn merged(&self, other: &MassGaussian, filter: ScreenFilter) -> Option<(MassGaussian, Joint)> {
        let joint = Joint::of(self, other);
        let mass = self.mass + other.mass - joint.mass;
        let mix = |a: f64, b: f64| a + joint.share * (b - a);
        let filter_variance = mix(self.filter_variance, other.filter_variance);
        // Mean relative to this splat's.
        let mean = (other.mass * joint.offset - joint.mass * joint.common_offset) / mass;
        let moment = |part: f64, covariance: DMat3, offset: DVec3| (covariance + square(offset - mean)) * (part / mass);
        let without = DMat3::from_diagonal(DVec3::splat(filter_variance));
        let mut body = MassGaussian {
            mean: self.mean + mean,
            covariance: moment(self.mass, self.covariance, DVec3::ZERO)
                + moment(other.mass, other.covariance, joint.offset)
                - moment(joint.mass, joint.covariance - without, joint.common_offset),
            thinnest: mix(self.thinnest, other.thinnest),
            filter_variance,
            ..*self
        };
        let (shadow, most) = (body.shadow(filter), f64::from(ALPHA_MAX));
        if mass > most * shadow {
            // Opacity is capped: excess mass enlarges the splat.
            body.covariance *= mass / (most * shadow);
        }
        let shadow = body.shadow(filter);
        body.opacity = (mass / shadow).min(most);
        Some((body.drawn_with(shadow)?, joint))
    }
}
