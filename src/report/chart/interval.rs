//! A figure with the interval that it is known to.

/// A figure and its 95 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interval {
    /// The figure: a mean or a median.
    pub value: f64,
    /// Lower end; the figure itself where one measurement says nothing about its spread.
    pub low: f64,
    /// Upper end, likewise.
    pub high: f64,
    /// Measurements.
    pub count: usize,
}

/// 97.5 % quantiles of Student's t distribution for 1 to 30 degrees of freedom (Abramowitz and Stegun, table
/// 26.10).
const STUDENT: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160,
    2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056,
    2.052, 2.048, 2.045, 2.042,
];

impl Interval {
    /// A figure whose interval is known.
    pub fn new(value: f64, low: f64, high: f64, count: usize) -> Interval {
        Interval {
            value,
            low,
            high,
            count,
        }
    }

    /// The mean of repeated measurements, and the interval that holds the true one with 95 % confidence if
    /// they scatter normally: Student's t.
    pub fn of_mean(values: &[f64]) -> Interval {
        let count = values.len();
        let mean = values.iter().sum::<f64>() / count as f64;
        let half = match count {
            0 | 1 => 0.0,
            _ => {
                let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
                let deviation = (square / (count - 1) as f64).sqrt();
                // Beyond the table its last entry is a little too careful.
                let student = STUDENT[(count - 2).min(STUDENT.len() - 1)];
                student * deviation / (count as f64).sqrt()
            }
        };
        Interval::new(mean, mean - half, mean + half, count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_mean_is_students() {
        // Three values of standard deviation 1: 4.303 / √3 to either side.
        let three = Interval::of_mean(&[9.0, 10.0, 11.0]);
        assert_eq!((three.value, three.count), (10.0, 3));
        assert!((three.high - 10.0 - 2.4843).abs() < 1e-4, "{three:?}");
        assert!((three.high + three.low - 20.0).abs() < 1e-12);
        let one = Interval::of_mean(&[7.0]);
        assert_eq!((one.low, one.high), (7.0, 7.0));
        assert!(Interval::of_mean(&[]).value.is_nan());
    }
}
