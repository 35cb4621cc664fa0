//! Law of quality over the number of splats, and its knee.

use crate::stats::Line;
use serde::{Deserialize, Serialize};

/// The law PSNR = a − b N^−γ of a scene with N splats.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Law {
    /// a: the limit for N → ∞, decibels.
    pub limit_db: f64,
    /// b.
    pub factor: f64,
    /// γ.
    pub exponent: f64,
}

/// Candidate exponents γ, in twentieths.
const EXPONENTS: std::ops::RangeInclusive<u32> = 1..=60;

impl Law {
    /// Least-squares fit to (splats, decibels); `None` for fewer than three points, or if they do not rise with the
    /// splats.
    pub fn through(points: &[[f64; 2]]) -> Option<Law> {
        if points.len() < 3 {
            return None;
        }
        let fits = EXPONENTS.filter_map(|i| fit(points, f64::from(i) / 20.0));
        let best = fits.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, law)| law).filter(|law| law.factor > 0.0)
    }

    /// PSNR with `splats` splats, decibels.
    pub fn at(&self, splats: f64) -> f64 {
        self.limit_db - self.factor * splats.powf(-self.exponent)
    }

    /// Number of splats at which a tenth more gives `gain` decibels.
    pub fn knee(&self, gain: f64) -> f64 {
        let share = self.factor * (1.0 - 1.1_f64.powf(-self.exponent));
        (share / gain).powf(1.0 / self.exponent)
    }
}

/// Best fit at a given exponent, and its sum of squared residuals.
fn fit(points: &[[f64; 2]], exponent: f64) -> Option<(f64, Law)> {
    // Counts in units of the first: powers of large numbers would lose precision.
    let unit = points[0][0].max(1.0);
    let xs: Vec<f64> = points.iter().map(|p| (p[0] / unit).powf(-exponent)).collect();
    let ys: Vec<f64> = points.iter().map(|p| p[1]).collect();
    let line = Line::through(&xs, &ys)?;
    let law = Law {
        limit_db: line.intercept,
        factor: -line.slope * unit.powf(exponent),
        exponent,
    };
    let squares = points.iter().map(|p| (law.at(p[0]) - p[1]).powi(2)).sum();
    Some((squares, law))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_law_is_found_again_and_its_knee_is_where_a_tenth_more_gives_just_the_gain() {
        let law = Law {
            limit_db: 31.0,
            factor: 900.0,
            exponent: 0.6,
        };
        let points = [1e4, 2e4, 4e4, 9e4].map(|n| [n, law.at(n)]);
        let found = Law::through(&points);
        let near = |found: Law| (found.limit_db - 31.0).abs() < 1e-6 && (found.exponent - 0.6).abs() < 1e-9;
        assert!(found.is_some_and(near), "{found:?}");
        let knee = law.knee(0.02);
        assert!((law.at(1.1 * knee) - law.at(knee) - 0.02).abs() < 1e-9);
        assert!(law.knee(0.01) > knee);
    }

    #[test]
    fn what_does_not_rise_has_no_law() {
        assert_eq!(Law::through(&[[1e4, 30.0], [2e4, 29.0], [4e4, 28.0]]), None);
        assert_eq!(Law::through(&[[1e4, 30.0]; 5]), None);
        assert_eq!(Law::through(&[[1e4, 30.0], [2e4, 31.0]]), None);
    }
}
