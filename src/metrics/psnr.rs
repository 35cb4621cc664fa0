//! Peak signal-to-noise ratio.

use super::{Image, check, weighted_mean};
use rayon::prelude::*;

/// The mean over pixels and channels of the squared difference.
pub fn mean_squared_error(a: Image<'_>, b: Image<'_>, weights: Option<&[f32]>) -> f64 {
    check(a, b, weights);
    let squared = |(a, b): (&[f32; 3], &[f32; 3])| {
        let channel = |c: usize| (f64::from(a[c]) - f64::from(b[c])).powi(2);
        (channel(0) + channel(1) + channel(2)) / 3.0
    };
    let errors: Vec<f64> = a.rgb.par_iter().zip(b.rgb).map(squared).collect();
    weighted_mean(&errors, weights)
}

/// 10 log10(1 / mean squared error), in decibels: peak 1, infinite for equal images.
pub fn psnr_db(a: Image<'_>, b: Image<'_>, weights: Option<&[f32]>) -> f64 {
    -10.0 * mean_squared_error(a, b, weights).log10()
}
