//! Cost of a merge: difference between the pictures of two splats and of the merged one.

use super::joint::Joint;
use super::mass::MassGaussian;
use super::projection::ProjectedGaussian;
use crate::scene::ScreenFilter;
use glam::DVec3;
use std::f64::consts::TAU;

/// Weight of the colour difference beside the field's error, in which faint splats may differ arbitrarily.
const COLOR: f64 = 1e-6;

/// Products of two splats' colours, summed over red, green and blue, as means over all directions, plus 1, the product
/// of their covers: hiding the background counts even for dark splats.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColorProducts {
    pub first: f64,
    pub second: f64,
    pub across: f64,
}

impl ColorProducts {
    /// Product of two mixtures of the colours.
    fn product(&self, a: [f64; 2], b: [f64; 2]) -> f64 {
        let across = a[0] * b[1] + a[1] * b[0];
        a[0] * b[0] * self.first + across * self.across + a[1] * b[1] * self.second
    }

    /// Squared distance of the colours.
    fn distance(&self) -> f64 {
        (self.first + self.second - 2.0 * self.across).max(0.0)
    }
}

/// Term of the error.
struct Part {
    sign: f64,
    projection: ProjectedGaussian,
    /// Colour as a mixture of the two splats'.
    mixture: [f64; 2],
}

/// Cost of replacing both splats by `merged`: the squared error of colour and cover, summed over pixels at the scale of
/// the scene's views, as a mean over pictures along the three axes of their mixture, each weighted by the share of
/// views like it.
///
/// It is ∫ ‖c α G + c′ α′ G′ − ½ (c + c′) α α′ G G′ − c″ α″ G″‖² over each picture's plane, and exact: every term is an
/// integral of a product of Gaussians. It is measured in pixels and free of world units; an error over space itself
/// would hardly count thin splats. Infinite instead of NaN.
pub(super) fn cost(
    (a, b): (&MassGaussian, &MassGaussian),
    (merged, joint): (&MassGaussian, &Joint),
    tones: &ColorProducts,
    filter: ScreenFilter,
) -> f64 {
    let a_projections = a.projections(DVec3::ZERO, &joint.axes);
    let b_projections = b.projections(joint.offset, &joint.axes);
    let merged_projections = merged.projections(merged.mean - a.mean, &joint.axes);
    let shares = [1.0 - joint.share, joint.share];
    let error = |axis: usize| {
        let [a, b] = [a_projections[axis], b_projections[axis]];
        let part = |sign, projection, mixture| Part {
            sign,
            projection,
            mixture,
        };
        let parts = [
            part(1.0, a, [1.0, 0.0]),
            part(1.0, b, [0.0, 1.0]),
            part(-1.0, a.times(&b), [0.5, 0.5]),
            part(-1.0, merged_projections[axis], shares),
        ];
        let mut error = 0.0;
        for (i, a) in parts.iter().enumerate() {
            let others = parts[..i].iter().map(|b| product(a, b, tones));
            error += product(a, a, tones) + 2.0 * others.sum::<f64>();
        }
        joint.views[axis] * error.max(0.0)
    };
    let error = (0..3).map(error).sum::<f64>();
    let color = COLOR * TAU * merged.drawn.shadow * tones.distance();
    let cost = (error + color) / merged.pixel(filter);
    if cost.is_nan() { f64::INFINITY } else { cost }
}

/// ∫ of the product of two terms.
fn product(a: &Part, b: &Part, tones: &ColorProducts) -> f64 {
    let light = a.projection.times(&b.projection).light();
    a.sign * b.sign * tones.product(a.mixture, b.mixture) * light
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Splats;

    /// Splats of mean, scale and opacity logit, all with the same rotation.
    fn bodies(rows: &[([f32; 3], [f32; 3], f32)]) -> Vec<MassGaussian> {
        let splats = Splats {
            mean: rows.iter().map(|row| row.0).collect(),
            quaternion: vec![[0.9, 0.2, -0.3, 0.1]; rows.len()],
            log_scale: rows.iter().map(|row| row.1.map(f32::ln)).collect(),
            opacity_logit: rows.iter().map(|row| row.2).collect(),
            ..Splats::default()
        };
        let body = |i| MassGaussian::new(&splats, i, 10.0, ScreenFilter::Classic).unwrap();
        (0..rows.len()).map(body).collect()
    }

    /// Colours of one channel, and the cover.
    fn tones(a: f64, b: f64) -> ColorProducts {
        ColorProducts {
            first: a * a + 1.0,
            second: b * b + 1.0,
            across: a * b + 1.0,
        }
    }

    fn price(a: &MassGaussian, b: &MassGaussian, tones: &ColorProducts) -> f64 {
        let (merged, joint) = a.merged(b, ScreenFilter::Classic).unwrap();
        cost((a, b), (&merged, &joint), tones, ScreenFilter::Classic)
    }

    /// Energy of one splat alone: the scale of all costs.
    fn energy(a: &MassGaussian, tones: &ColorProducts) -> f64 {
        let projections = a.projections(DVec3::ZERO, &glam::DMat3::IDENTITY);
        let light = projections
            .iter()
            .map(|projection| projection.times(projection).light());
        tones.first * light.sum::<f64>() / 3.0 / a.pixel(ScreenFilter::Classic)
    }

    /// Against the integral of the squared difference, by summation over planes.
    #[test]
    fn the_price_is_the_error_that_a_grid_of_pixels_finds() {
        let found = bodies(&[
            ([0.0, 0.0, 0.0], [0.5, 0.3, 0.2], 0.5),
            ([0.3, -0.2, 0.4], [0.25, 0.4, 0.3], 1.5),
        ]);
        let (a, b) = (&found[0], &found[1]);
        let (merged, joint) = a.merged(b, ScreenFilter::Classic).unwrap();
        let colors = [0.8, 0.3];
        let mean_color = colors[0] + joint.share * (colors[1] - colors[0]);
        let projections = [
            a.projections(DVec3::ZERO, &joint.axes),
            b.projections(joint.offset, &joint.axes),
            merged.projections(merged.mean - a.mean, &joint.axes),
        ];
        let (step, mut sum) = (0.05, 0.0);
        for axis in 0..3 {
            let projections = projections.map(|projections| projections[axis]);
            for i in -100..100 {
                for k in -100..100 {
                    let at = [step * f64::from(i), step * f64::from(k)];
                    let [g, h, m] = projections.map(|s| s.value(at));
                    let color = colors[0] * g + colors[1] * h - 0.5 * (colors[0] + colors[1]) * g * h - mean_color * m;
                    let cover = g + h - g * h - m;
                    sum += (color * color + cover * cover) * step * step * joint.views[axis];
                }
            }
        }
        let wanted = sum / merged.pixel(ScreenFilter::Classic);
        let price = price(a, b, &tones(colors[0], colors[1]));
        let color = COLOR * TAU * merged.drawn.shadow * 0.25 / merged.pixel(ScreenFilter::Classic);
        assert!((price - wanted - color).abs() < 1e-9 * wanted, "{price}, {wanted}");
    }

    #[test]
    fn either_may_come_first() {
        let found = bodies(&[
            ([0.0, 0.0, 0.0], [0.5, 0.3, 0.2], 0.5),
            ([0.3, -0.2, 0.4], [0.25, 0.4, 0.3], 1.5),
            ([0.1, 0.2, 0.1], [0.02, 0.4, 0.3], -3.0),
        ]);
        for (i, k) in [(0, 1), (0, 2), (1, 2)] {
            let one = price(&found[i], &found[k], &tones(0.2, 0.9));
            let other = price(&found[k], &found[i], &tones(0.9, 0.2));
            assert!((one / other - 1.0).abs() < 1e-9, "{one}, {other}");
        }
    }

    /// Halves of a faint splat, a fraction of its deviation apart, are nearly the splat again.
    #[test]
    fn halves_merge_back_for_next_to_nothing() {
        let half = |sign: f32| {
            let turned = glam::Quat::from_xyzw(0.2, -0.3, 0.1, 0.9).normalize();
            let mean = (turned * glam::Vec3::X * 0.2 * sign).to_array();
            (mean, [(0.25_f32 - 0.04).sqrt(), 0.3, 0.2], -5.0)
        };
        let halves = bodies(&[half(1.0), half(-1.0)]);
        let same = tones(0.5, 0.5);
        let scale = energy(&halves[0], &same);
        let relative = price(&halves[0], &halves[1], &same) / scale;
        assert!(relative < 1e-2, "{relative}");
        // Different colours or a larger distance cost more.
        let other = price(&halves[0], &halves[1], &tones(0.0, 1.0)) / scale;
        assert!(other > 20.0 * relative, "{other}");
        let apart = bodies(&[half(1.0), half(-6.0)]);
        assert!(price(&apart[0], &apart[1], &same) / scale > 100.0 * relative);
    }

    /// Coincident faint splats cost nothing but their mutual occlusion.
    #[test]
    fn twins_are_free() {
        let twins = bodies(&[([1.0, 2.0, 3.0], [0.5, 0.3, 0.2], -9.0); 2]);
        let same = tones(0.7, 0.7);
        let relative = price(&twins[0], &twins[1], &same) / energy(&twins[0], &same);
        assert!(relative < 1e-6, "{relative}");
        // Opaque ones have a flatter top than a Gaussian. One of them alone would be wrong by ∫ (G − G²)² / ∫ G² = 1 −
        // 4 / 3 + 1 / 2.
        let twins = bodies(&[([1.0, 2.0, 3.0], [0.5, 0.3, 0.2], 6.0); 2]);
        let relative = price(&twins[0], &twins[1], &same) / energy(&twins[0], &same);
        assert!(relative < 1.0 / 6.0 / 3.0, "{relative}");
    }
}
