//! Structural similarity (Wang et al. 2004), as in 3D Gaussian splatting.
//!
//! Window: 11 × 11 Gaussian, σ = 1.5 pixels, normalised, separable. Border: every pixel has a value; both images are
//! zero outside. Constants: C1 = 0.01², C2 = 0.03² for values of 0 to 1. Variances are E\[x²\] − E\[x\]², in `f64`,
//! where the cancellation that spoils them in `f32` (5e-4 on flat bright patches) is far below any digit reported. The
//! figure is the mean over pixels and the three channels.

use super::{Image, check, weighted_mean};
use rayon::prelude::*;

/// Pixels of the window to each side of its centre.
const RADIUS: usize = 5;
/// The window's standard deviation in pixels.
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Per-pixel means of a, b, a², b², ab under the window.
type Moments = [f64; 5];

/// One axis of the window, which is the outer product of this with itself; sums to 1.
fn axis_window() -> [f64; 2 * RADIUS + 1] {
    let mut window = [0.0; 2 * RADIUS + 1];
    for (i, weight) in window.iter_mut().enumerate() {
        let x = (i as f64 - RADIUS as f64) / SIGMA;
        *weight = (-0.5 * x * x).exp();
    }
    let sum: f64 = window.iter().sum();
    window.map(|weight| weight / sum)
}

/// Mean structural similarity of two images; window, border and constants as in the module.
pub fn ssim(a: Image<'_>, b: Image<'_>, weights: Option<&[f32]>) -> f64 {
    check(a, b, weights);
    let window = axis_window();
    let mut map = vec![0.0; a.rgb.len()];
    for channel in 0..3 {
        let rows = blur_rows(a, b, channel, &window);
        map.par_chunks_mut(a.width.max(1))
            .enumerate()
            .for_each(|(y, map)| add_row(map, &rows, y, a.height, &window));
    }
    weighted_mean(&map, weights)
}

/// The moments of one channel, blurred along x.
fn blur_rows(a: Image<'_>, b: Image<'_>, channel: usize, window: &[f64]) -> Vec<Moments> {
    let width = a.width.max(1);
    let mut rows = vec![Moments::default(); a.rgb.len()];
    rows.par_chunks_mut(width)
        .zip(a.rgb.par_chunks(width).zip(b.rgb.par_chunks(width)))
        .for_each(|(out, (a, b))| {
            for (x, out) in out.iter_mut().enumerate() {
                for source in reach(x, width) {
                    let weight = window[source + RADIUS - x];
                    let (a, b) = (f64::from(a[source][channel]), f64::from(b[source][channel]));
                    for (sum, value) in out.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                        *sum += weight * value;
                    }
                }
            }
        });
    rows
}

/// Blurs along y and adds a third of the similarity of row `y`, for one of three channels.
fn add_row(map: &mut [f64], rows: &[Moments], y: usize, height: usize, window: &[f64]) {
    let width = map.len();
    let mut blurred = vec![Moments::default(); width];
    for source in reach(y, height) {
        let weight = window[source + RADIUS - y];
        for (out, row) in blurred.iter_mut().zip(&rows[source * width..]) {
            for (sum, value) in out.iter_mut().zip(row) {
                *sum += weight * value;
            }
        }
    }
    for (map, moments) in map.iter_mut().zip(&blurred) {
        *map += similarity(moments) / 3.0;
    }
}

/// Indices of `0..len` within the window around `at`; the zeros beyond add nothing.
fn reach(at: usize, len: usize) -> std::ops::Range<usize> {
    at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(len)
}

fn similarity(&[mean_a, mean_b, square_a, square_b, product]: &Moments) -> f64 {
    let variance_a = square_a - mean_a * mean_a;
    let variance_b = square_b - mean_b * mean_b;
    let covariance = product - mean_a * mean_b;
    ((2.0 * mean_a * mean_b + C1) * (2.0 * covariance + C2))
        / ((mean_a * mean_a + mean_b * mean_b + C1) * (variance_a + variance_b + C2))
}
