//! Figure with its 95 % interval.

use super::student_t_975;

/// Arithmetic mean; 0 if empty.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// A figure and its 95 % interval.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interval {
    /// Mean or median.
    pub value: f64,
    /// Lower end; equal to `value` for a single measurement, which has no spread.
    pub low: f64,
    /// Upper end, likewise.
    pub high: f64,
    /// Number of measurements.
    pub count: usize,
}

impl Interval {
    /// A figure with a given interval.
    pub fn new(value: f64, low: f64, high: f64, count: usize) -> Interval {
        Interval {
            value,
            low,
            high,
            count,
        }
    }

    /// Mean of repeated measurements, and the interval that holds the true mean with 95 % confidence if they are
    /// normally distributed (Student's t).
    pub fn of_mean(values: &[f64]) -> Interval {
        let count = values.len();
        let mean = values.iter().sum::<f64>() / count as f64;
        let half = match count {
            0 | 1 => 0.0,
            _ => {
                let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
                let deviation = (square / (count - 1) as f64).sqrt();
                student_t_975(count - 1) * deviation / (count as f64).sqrt()
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
