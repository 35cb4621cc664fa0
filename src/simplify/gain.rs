//! Gain of more splats: PSNR difference on held-out views, by view, per tenth more splats.

use crate::stats::{mean, student_t_95};

/// Mean over views with its two one-sided 95 % bounds (Student's t).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Mean over the views.
    pub mean: f64,
    /// Lower bound: the true mean is below it with probability 1/20.
    pub low: f64,
    /// Upper bound: the true mean is above it with probability 1/20.
    pub high: f64,
}

/// Number of 10 % steps from `before` to `after`; negative if `after` is smaller.
pub fn steps_of_ten_percent(before: usize, after: usize) -> f64 {
    (after.max(1) as f64 / before.max(1) as f64).ln() / 1.1_f64.ln()
}

/// By view, `after` − `before`.
pub fn differences(before: &[f64], after: &[f64]) -> Vec<f64> {
    assert_eq!(before.len(), after.len(), "scores of the same views");
    before.iter().zip(after).map(|(b, a)| a - b).collect()
}

/// Mean of some numbers and its bounds; the bounds of a single number are the number itself.
pub fn estimate(numbers: &[f64]) -> Estimate {
    let mean = mean(numbers);
    let freedom = numbers.len().saturating_sub(1);
    if freedom == 0 {
        return Estimate {
            mean,
            low: mean,
            high: mean,
        };
    }
    let square: f64 = numbers.iter().map(|x| (x - mean).powi(2)).sum();
    let error = (square / freedom as f64 / numbers.len() as f64).sqrt();
    let width = student_t_95(freedom) * error;
    Estimate {
        mean,
        low: mean - width,
        high: mean + width,
    }
}

/// Mean squared error over views of these PSNR, decibels.
pub fn error(psnr_db: &[f64]) -> f64 {
    let error = |psnr: &f64| 10_f64.powf(-psnr / 10.0);
    let errors: Vec<f64> = psnr_db.iter().map(error).collect();
    mean(&errors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_those_of_students_t() {
        // Mean 2, standard deviation 1, three samples: 2.92 / √3.
        let found = estimate(&[1.0, 2.0, 3.0]);
        assert!((found.mean - found.low - 2.920 / 3_f64.sqrt()).abs() < 1e-9);
        assert!((found.high - found.mean - 2.920 / 3_f64.sqrt()).abs() < 1e-9);
        assert_eq!(estimate(&[0.5]).low, 0.5);
        assert_eq!(estimate(&[]).mean, 0.0);
    }

    #[test]
    fn errors_are_averaged_and_decibels_are_not() {
        assert!((error(&[10.0, 20.0]) - 0.055).abs() < 1e-12);
    }

    #[test]
    fn tenths_add_up() {
        assert!((steps_of_ten_percent(1000, 1210) - 2.0).abs() < 1e-12);
        assert!((steps_of_ten_percent(1210, 1000) + 2.0).abs() < 1e-12);
        assert_eq!(steps_of_ten_percent(5, 5), 0.0);
    }
}
