//! Comparison of gradients with the exact ones: errors and broken bounds.

use super::super::frames::larger;
use crate::reference::bound::GradientBounds;
use crate::reference::gradient::SplatGradients;
use crate::scene::Splats;

/// Least denominator of relative errors, as a share of the group's root mean square: a value that is small in its group
/// is the remainder of terms that cancel.
const SHARE: f64 = 0.01;

/// Errors of all gradients, relative, ascending.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GradientComparison {
    pub(super) errors: Vec<f64>,
    /// Proven bounds of the same, ascending.
    pub(super) bounds: Vec<f64>,
    /// Largest distance of a gradient beyond its bound and rounding; positive if a bound is broken.
    pub(super) excess: f64,
}

/// The value at a share of an ascending list; 0 if empty.
pub(super) fn percentile(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len().max(1) - 1;
    sorted.get((last as f64 * share) as usize).copied().unwrap_or(0.0)
}

/// Compares gradients with the exact ones, by the bounds of one setting. Splats on a kink are left out.
pub(super) fn compare(
    found: &Splats,
    exact: &SplatGradients,
    bounds: &GradientBounds,
    index: usize,
) -> GradientComparison {
    let (bound, rounding) = (&bounds.bounds[index], &bounds.rounding);
    let mut comparison = GradientComparison {
        errors: Vec::new(),
        bounds: Vec::new(),
        excess: f64::NEG_INFINITY,
    };
    macro_rules! kind {
        ($field:ident $(. $flat:ident ())?) => {
            comparison.add(
                found.$field $(.$flat())?.as_ref(),
                [exact, bound, rounding].map(|of| of.$field $(.$flat())?.as_ref()),
                &bounds.kinked,
            )
        };
    }
    kind!(mean.as_flattened());
    kind!(quaternion.as_flattened());
    kind!(log_scale.as_flattened());
    kind!(opacity_logit);
    kind!(sh);
    comparison.errors.sort_by(f64::total_cmp);
    comparison.bounds.sort_by(f64::total_cmp);
    comparison
}

impl GradientComparison {
    /// Adds a group of parameters, those of a splat one after the other.
    fn add(&mut self, found: &[f32], [exact, bound, rounding]: [&[f64]; 3], kinked: &[bool]) {
        let numbers = exact.len() / kinked.len().max(1);
        let square: f64 = exact.iter().map(|e| e * e).sum();
        let floor = SHARE * (square / exact.len().max(1) as f64).sqrt();
        for (i, (&found, &exact)) in found.iter().zip(exact).enumerate() {
            let off = (f64::from(found) - exact).abs();
            // Invisible splats have no gradient, and no error.
            if kinked[i / numbers] || (off == 0.0 && exact == 0.0) {
                continue;
            }
            let size = exact.abs().max(floor);
            self.excess = larger(self.excess, (off - bound[i] - rounding[i]) / size);
            self.errors.push(off / size);
            self.bounds.push(bound[i] / size);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradients(mean: f64, opacity: f64) -> SplatGradients {
        SplatGradients {
            mean: vec![[mean; 3]; 2],
            quaternion: vec![[0.0; 4]; 2],
            log_scale: vec![[0.0; 3]; 2],
            opacity_logit: vec![opacity; 2],
            sh: Vec::new(),
        }
    }

    fn found(mean: f32, opacity: f32) -> Splats {
        Splats {
            mean: vec![[1.0; 3], [1.0, mean, 1.0]],
            quaternion: vec![[0.0; 4]; 2],
            log_scale: vec![[0.0; 3]; 2],
            opacity_logit: vec![opacity; 2],
            ..Splats::default()
        }
    }

    #[test]
    fn a_gradient_beyond_its_own_bound_is_found() {
        let exact = gradients(1.0, 2.0);
        let bounds = |kinked| GradientBounds {
            bounds: vec![gradients(9.0, 9.0), gradients(0.25, 0.5)],
            rounding: gradients(0.0625, 0.0),
            kinked: vec![false, kinked],
        };
        let kept = compare(&found(1.25, 2.5), &exact, &bounds(false), 1);
        // One error equals its bound to the last bit.
        assert_eq!(kept.excess, 0.0);
        assert_eq!((kept.errors.len(), kept.bounds.len()), (8, 8));
        assert_eq!(kept.errors[7], 0.25);
        let broken = compare(&found(1.5, 2.0), &exact, &bounds(false), 1);
        assert_eq!(broken.excess, 0.5 - 0.25 - 0.0625);
        // No bound holds on a kink.
        assert!(compare(&found(1.5, 2.0), &exact, &bounds(true), 1).excess <= 0.0);
        let poison = compare(&found(f32::NAN, 2.0), &exact, &bounds(false), 1);
        assert!(poison.excess.is_nan());
    }
}
