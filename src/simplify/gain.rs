//! What more splats are worth: decibels on held-out views, view by view, for every tenth more.

use crate::stats::{mean, student_t_95};

/// A mean over views, with the bounds that it lies within at 95 % each (Student's t).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Over the views.
    pub mean: f64,
    /// The true mean lies below this in one case of twenty.
    pub low: f64,
    /// The true mean lies above this in one case of twenty.
    pub high: f64,
}

/// How many times a tenth more `after` is than `before`; negative if it is less.
pub fn steps_of_ten_percent(before: usize, after: usize) -> f64 {
    (after.max(1) as f64 / before.max(1) as f64).ln() / 1.1_f64.ln()
}

/// By view, what the second scores are above the first.
pub fn differences(before: &[f64], after: &[f64]) -> Vec<f64> {
    assert_eq!(before.len(), after.len(), "scores of the same views");
    before.iter().zip(after).map(|(b, a)| a - b).collect()
}

/// The mean of some numbers, and its bounds: of a single one nothing is known but itself.
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

/// The mean squared error, over all views, of views that have such PSNR; decibels.
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
        // Mean 2, standard deviation 1, three of them: 2.92 / √3.
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
