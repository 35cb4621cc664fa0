//! Times as powers of a size, with confidence intervals.

use crate::stats::{Line, student_t_975};
use serde::Serialize;

/// Time as a power of size, fitted to measurements.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exponent {
    /// Varied size: `splats` or `pixels`.
    pub over: &'static str,
    /// Fixed size: `1920x1080`.
    pub at: String,
    /// Time: `clock` or `processor`.
    pub by: &'static str,
    /// Number of sizes.
    pub points: usize,
    /// Slope of log time over log size, by least squares.
    pub slope: f64,
    /// 95 % interval of the slope by Student's t, for normal errors of equal variance; `None` for two points.
    pub interval: Option<[f64; 2]>,
    /// Largest factor by which doubling the size multiplies the time, over neighbouring sizes.
    pub doubling: f64,
    /// Smaller of those two sizes.
    pub doubling_from: f64,
}

impl Exponent {
    /// Fits (size, time) pairs, all positive. `None` unless there are two different sizes.
    pub fn of([over, by]: [&'static str; 2], at: String, points: &[(f64, f64)]) -> Option<Exponent> {
        let mut points = points.to_vec();
        points.retain(|&(size, time)| size > 0.0 && time > 0.0);
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup_by(|a, b| a.0 == b.0);
        let (sizes, times): (Vec<f64>, Vec<f64>) = points.iter().map(|p| (p.0.ln(), p.1.ln())).unzip();
        let line = Line::through(&sizes, &times)?;
        let slope = line.slope;
        let freedom = points.len() - 2;
        let steps = points.windows(2).map(|pair| {
            let [(size, time), (next, later)] = [pair[0], pair[1]];
            ((later / time).powf(1.0 / (next / size).log2()), size)
        });
        let (doubling, doubling_from) = steps.max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Exponent {
            over,
            at,
            by,
            points: points.len(),
            slope,
            interval: (freedom > 0).then(|| {
                let reach = student_t_975(freedom) * line.slope_error;
                [slope - reach, slope + reach]
            }),
            doubling,
            doubling_from,
        })
    }

    /// One line of text.
    pub fn line(&self) -> String {
        let interval = match self.interval {
            Some([low, high]) => format!(" [{low:.2}, {high:.2}]"),
            None => String::new(),
        };
        format!(
            "{} time over {} at {}: exponent {:.2}{interval} from {} sizes; doubling costs {:.2} times at most \
             (from {})",
            self.by, self.over, self.at, self.slope, self.points, self.doubling, self.doubling_from
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exponent(points: &[(f64, f64)]) -> Option<Exponent> {
        Exponent::of(["splats", "clock"], "here".into(), points)
    }

    #[test]
    fn powers_have_their_exponents() {
        let power = |p: f64| [1e4, 3e4, 1e5, 1e6].map(|n: f64| (n, 5.0 * n.powf(p)));
        for p in [0.5, 1.0, 1.3] {
            let found = exponent(&power(p)).map(|e| (e.slope, e.interval, e.doubling));
            let Some((slope, Some([low, high]), doubling)) = found else {
                panic!("{found:?}")
            };
            assert!((slope - p).abs() < 1e-9 && high - low < 1e-6, "{slope} [{low}, {high}]");
            assert!((doubling - 2f64.powf(p)).abs() < 1e-9, "{doubling}");
        }
    }

    #[test]
    fn intervals_are_those_of_the_textbook() {
        // Draper and Smith with y = 1, 2, 4 at x = 0, 1, 2: slope 1.5, residuals 1/6, −1/3, 1/6, so that the error is
        // √(1/6 / 2), and t of one degree 12.706.
        let logs = [(0.0, 1.0), (1.0, 2.0), (2.0, 4.0)].map(|(x, y): (f64, f64)| (x.exp(), y.exp()));
        let Some(found) = exponent(&logs) else { panic!() };
        let reach = 12.706 * (1.0f64 / 12.0).sqrt();
        let [low, high] = found.interval.unwrap_or_default();
        assert!((found.slope - 1.5).abs() < 1e-12);
        assert!((low - 1.5 + reach).abs() < 1e-9 && (high - 1.5 - reach).abs() < 1e-9);
        // From the second size to the third, time grows by e² and size by e: a factor of 4 per doubling.
        assert!((found.doubling - 4.0).abs() < 1e-9 && found.doubling_from == 1f64.exp());
    }

    #[test]
    fn too_few_sizes_have_no_exponent() {
        assert_eq!(exponent(&[]), None);
        assert_eq!(exponent(&[(5.0, 1.0), (5.0, 2.0)]), None);
        let two = exponent(&[(1.0, 1.0), (2.0, 8.0), (0.0, 1.0)]);
        assert_eq!(two.map(|e| (e.points, e.interval.is_none())), Some((2, true)));
    }
}
