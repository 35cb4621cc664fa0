//! Straight line through points by least squares.

use super::mean;

/// Line y = intercept + slope · x fitted by least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Value at x = 0.
    pub intercept: f64,
    /// Rise per unit of x.
    pub slope: f64,
    /// Standard error of the slope; 0 for two points.
    pub slope_error: f64,
}

impl Line {
    /// Line through (x, y) pairs; `None` unless there are two different x.
    pub fn through(xs: &[f64], ys: &[f64]) -> Option<Line> {
        assert_eq!(xs.len(), ys.len(), "one y for each x");
        let (x, y) = (mean(xs), mean(ys));
        let spread: f64 = xs.iter().map(|a| (a - x).powi(2)).sum();
        if xs.len() < 2 || spread <= 0.0 {
            return None;
        }
        let slope = xs.iter().zip(ys).map(|(a, b)| (a - x) * (b - y)).sum::<f64>() / spread;
        let residuals = xs.iter().zip(ys).map(|(a, b)| b - y - slope * (a - x));
        let freedom = (xs.len() - 2).max(1) as f64;
        let variance = residuals.map(|r| r * r).sum::<f64>() / freedom;
        Some(Line {
            intercept: y - slope * x,
            slope,
            slope_error: (variance / spread).sqrt(),
        })
    }
}
