//! What two splats have in common, seen from all around.

use super::axes::{axes, mean_shadow, square};
use super::mass::{Drawn, MassGaussian, PixelFilter};
use crate::layout::ALPHA_MAX;
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// What two splats have in common: 1 − (1 − α G) (1 − α′ G′) = α G + α′ G′ − α α′ G G′ is what both cover, and a
/// product of Gaussians is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Joint {
    /// From the first one's mean to the other's.
    pub offset: DVec3,
    /// The axes of their mixture, along which they are looked at.
    pub axes: DMat3,
    /// How much the view along each counts; 1 in all. Along the axis of a disc it is what most views show, along that
    /// of a needle what hardly any do: a direction is like it where the sines are small beside the ratio of deviations.
    pub views: DVec3,
    /// The other's share of the colour: either is before the other in half of the views.
    pub share: f64,
    /// The mass of what they have in common: as large a part of the mixture's as of what the three views show.
    pub mass: f64,
    /// Where that lies in space: G G′.
    pub covariance: DMat3,
    /// From the first one's mean to that of G G′.
    pub common_offset: DVec3,
}

impl Joint {
    pub(super) fn of(a: &MassGaussian, b: &MassGaussian) -> Joint {
        let offset = b.mean - a.mean;
        let (first, second) = (&a.drawn, &b.drawn);
        let share = b.mass / (a.mass + b.mass);
        let mixture = first.covariance * (1.0 - share)
            + second.covariance * share
            + square(offset) * (share * (1.0 - share));
        let (variances, axes) = axes(mixture);
        let variances = variances.max(DVec3::splat(a.filter_variance.min(b.filter_variance)));
        let inverse = variances.recip();
        let views = inverse / inverse.element_sum();
        let [one, other] = [a.turned(DVec3::ZERO, &axes), b.turned(offset, &axes)];
        let deviations = variances.map(f64::sqrt);
        let filled = |axis: usize| {
            let light = one.shade(axis).times(&other.shade(axis)).light() / TAU;
            views[axis] * light * deviations[axis] / deviations.element_product()
        };
        let common = mean_shadow(variances) * (0..3).map(filled).sum::<f64>();
        // No more than either.
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
    /// What both are together, and the one that stands for that: its mass, mean and covariance, and the opacity that
    /// gives that mass; where none does, opaque and larger. `None` where a number leaves its range.
    pub(super) fn merged(
        &self,
        other: &MassGaussian,
        pen: PixelFilter,
    ) -> Option<(MassGaussian, Joint)> {
        let joint = Joint::of(self, other);
        let mass = self.mass + other.mass - joint.mass;
        let mix = |a: f64, b: f64| a + joint.share * (b - a);
        let filter_variance = mix(self.filter_variance, other.filter_variance);
        // Where the mean is, counted from this one's.
        let mean = (other.mass * joint.offset - joint.mass * joint.common_offset) / mass;
        let moment = |part: f64, covariance: DMat3, offset: DVec3| {
            (covariance + square(offset - mean)) * (part / mass)
        };
        let without = DMat3::from_diagonal(DVec3::splat(filter_variance));
        let mut body = MassGaussian {
            mean: self.mean + mean,
            covariance: moment(self.mass, self.covariance, DVec3::ZERO)
                + moment(other.mass, other.covariance, joint.offset)
                - moment(joint.mass, joint.covariance - without, joint.common_offset),
            thinnest: mix(self.thinnest, other.thinnest),
            filter_variance,
            opacity: 0.0,
            mass,
            drawn: Drawn::NOTHING,
        };
        let (shadow, most) = (body.shadow(pen), f64::from(ALPHA_MAX));
        if mass > most * shadow {
            // Nothing is more than opaque: what is left over makes it larger.
            body.covariance *= mass / (most * shadow);
        }
        let shadow = body.shadow(pen);
        body.opacity = (mass / shadow).min(most);
        body.mass = body.opacity * shadow;
        body.drawn = Drawn::of(body.covariance, body.filter_variance);
        body.drawn.amplitude = body.mass / body.drawn.shadow;
        body.is_sound().then_some((body, joint))
    }
}
