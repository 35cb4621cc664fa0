//! How a time grows with the size of what takes it.

use serde::Serialize;

/// Time as a power of size, fitted to measurements.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exponent {
    /// What grows: `splats` or `pixels`.
    pub over: &'static str,
    /// What stays as it is meanwhile: `1920x1080`.
    pub at: String,
    /// Which time: `clock` or `processor`.
    pub by: &'static str,
    /// Sizes measured.
    pub points: usize,
    /// The slope of log time over log size, by least squares.
    pub slope: f64,
    /// Its 95 % interval by Student's t, for errors that are normal and alike; none for two points.
    pub interval: Option<[f64; 2]>,
    /// The most that doubling the size costs between any two neighbouring sizes, as a factor.
    pub doubling: f64,
    /// The size below which that was.
    pub doubling_from: f64,
}

impl Exponent {
    /// Fits (size, time) pairs, all positive. `None` unless there are two different sizes.
    pub fn of(
        [over, by]: [&'static str; 2],
        at: String,
        points: &[(f64, f64)],
    ) -> Option<Exponent> {
        let mut points = points.to_vec();
        points.retain(|&(size, time)| size > 0.0 && time > 0.0);
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup_by(|a, b| a.0 == b.0);
        let logs: Vec<[f64; 2]> = points.iter().map(|p| [p.0.ln(), p.1.ln()]).collect();
        let (slope, error) = fit(&logs)?;
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
                let reach = t_quantile(freedom) * error;
                [slope - reach, slope + reach]
            }),
            doubling,
            doubling_from,
        })
    }

    /// A line of a table for people.
    pub fn line(&self) -> String {
        let interval = match self.interval {
            Some([low, high]) => format!(" [{low:.2}, {high:.2}]"),
            None => String::new(),
        };
        format!(
            "{} time over {} at {}: exponent {:.2}{interval} from {} sizes; doubling costs {:.2} times at most (from {})",
            self.by, self.over, self.at, self.slope, self.points, self.doubling, self.doubling_from
        )
    }
}

/// The slope of a line by least squares, and its standard error (0 for two points).
fn fit(points: &[[f64; 2]]) -> Option<(f64, f64)> {
    let count = points.len() as f64;
    let mean = |axis: usize| points.iter().map(|p| p[axis]).sum::<f64>() / count;
    let (x, y) = (mean(0), mean(1));
    let spread: f64 = points.iter().map(|p| (p[0] - x).powi(2)).sum();
    if points.len() < 2 || spread <= 0.0 {
        return None;
    }
    let slope = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>() / spread;
    let rest = points.iter().map(|p| p[1] - y - slope * (p[0] - x));
    let freedom = (points.len() - 2).max(1) as f64;
    let variance = rest.map(|r| r * r).sum::<f64>() / freedom;
    Some((slope, (variance / spread).sqrt()))
}

/// The 97.5 % quantile of Student's t with so many degrees of freedom, to three digits (any table of it; beyond
/// ten degrees by the first terms of its expansion about the normal one, Abramowitz and Stegun 26.7.5).
pub fn t_quantile(freedom: usize) -> f64 {
    const FEW: [f64; 10] = [
        12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
    ];
    const NORMAL: f64 = 1.959_964;
    match FEW.get(freedom.wrapping_sub(1)) {
        Some(&quantile) => quantile,
        None => {
            let (z, n) = (NORMAL, freedom as f64);
            let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
            let third = 3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z;
            z + (z.powi(3) + z) / (4.0 * n) + second / (n * n) + third / (384.0 * n.powi(3))
        }
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
            assert!(
                (slope - p).abs() < 1e-9 && high - low < 1e-6,
                "{slope} [{low}, {high}]"
            );
            assert!((doubling - 2f64.powf(p)).abs() < 1e-9, "{doubling}");
        }
    }

    #[test]
    fn intervals_are_those_of_the_textbook() {
        // Draper and Smith's way with y = 1, 2, 4 at x = 0, 1, 2: slope 1.5, residuals 1/6, −1/3, 1/6, so that
        // the error is √(1/6 / 2), and t of one degree 12.706.
        let logs =
            [(0.0, 1.0), (1.0, 2.0), (2.0, 4.0)].map(|(x, y): (f64, f64)| (x.exp(), y.exp()));
        let Some(found) = exponent(&logs) else {
            panic!()
        };
        let reach = 12.706 * (1.0f64 / 12.0).sqrt();
        let [low, high] = found.interval.unwrap_or_default();
        assert!((found.slope - 1.5).abs() < 1e-12);
        assert!((low - 1.5 + reach).abs() < 1e-9 && (high - 1.5 - reach).abs() < 1e-9);
        // From the second size to the third, e²-fold in time per e-fold in size: 4 times a doubling.
        assert!((found.doubling - 4.0).abs() < 1e-9 && found.doubling_from == 1f64.exp());
    }

    #[test]
    fn too_few_sizes_have_no_exponent() {
        assert_eq!(exponent(&[]), None);
        assert_eq!(exponent(&[(5.0, 1.0), (5.0, 2.0)]), None);
        let two = exponent(&[(1.0, 1.0), (2.0, 8.0), (0.0, 1.0)]);
        assert_eq!(
            two.map(|e| (e.points, e.interval.is_none())),
            Some((2, true))
        );
    }

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (freedom, quantile) in [
            (1, 12.706),
            (10, 2.228),
            (11, 2.201),
            (20, 2.086),
            (120, 1.980),
        ] {
            assert!((t_quantile(freedom) - quantile).abs() < 2e-3, "{freedom}");
        }
    }
}
