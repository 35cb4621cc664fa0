//! Structural similarity, one value per pixel of one channel.
//!
//! An 11 × 11 Gaussian window of σ = 1.5 px, the image continued by zeros, C₁ = 0.01², C₂ = 0.03² (Wang
//! et al. 2004). Here the window is a plain double sum and variances are centred sums, `Σ g (x − μ)²`,
//! which cannot turn negative.

use super::{Dual, Real};
use rayon::prelude::*;

/// Pixels from the window's centre to its border.
pub const WINDOW_RADIUS: i64 = 5;
/// Standard deviation of the window, pixels.
pub const WINDOW_SIGMA: f64 = 1.5;
/// Stabilises the luminance term.
pub const C1: f64 = 0.01 * 0.01;
/// Stabilises the structure term.
pub const C2: f64 = 0.03 * 0.03;

/// The Gaussian window over an image of some size.
struct Window {
    /// The factors of one axis; their sum is 1.
    taps: Vec<f64>,
    width: i64,
    height: i64,
}

impl Window {
    fn new(width: usize, pixels: usize) -> Window {
        assert!(
            width > 0 && pixels.is_multiple_of(width),
            "{pixels} pixels in rows of {width}"
        );
        let gauss = |t: i64| (-((t * t) as f64) / (2.0 * WINDOW_SIGMA * WINDOW_SIGMA)).exp();
        let taps: Vec<f64> = (-WINDOW_RADIUS..=WINDOW_RADIUS).map(gauss).collect();
        let sum: f64 = taps.iter().sum();
        Window {
            taps: taps.iter().map(|t| t / sum).collect(),
            width: width as i64,
            height: (pixels / width) as i64,
        }
    }

    /// Pixels of the image that the window around `index` covers, with their weights.
    fn around(&self, index: usize) -> Vec<(usize, f64)> {
        let (x, y) = (index as i64 % self.width, index as i64 / self.width);
        let mut covered = Vec::with_capacity(121);
        for (row, v) in (y - WINDOW_RADIUS..).zip(&self.taps) {
            for (column, h) in (x - WINDOW_RADIUS..).zip(&self.taps) {
                if (0..self.height).contains(&row) && (0..self.width).contains(&column) {
                    covered.push(((row * self.width + column) as usize, v * h));
                }
            }
        }
        covered
    }
}

/// Moments of SSIM at one pixel.
#[derive(Clone, Copy)]
struct WindowMoments<R> {
    mean_x: R,
    mean_y: f64,
    variance_x: R,
    variance_y: f64,
    covariance: R,
}

impl<R: Real> WindowMoments<R> {
    fn under(window: &[(usize, f64)], x: &[R], y: &[f64]) -> WindowMoments<R> {
        let sum = |f: &dyn Fn(usize) -> f64| window.iter().map(|&(i, g)| g * f(i)).sum::<f64>();
        let sum_x = |f: &dyn Fn(usize) -> R| window.iter().map(|&(i, g)| R::of(g) * f(i)).sum::<R>();
        let mean_x = sum_x(&|i| x[i]);
        let mean_y = sum(&|i| y[i]);
        // The zeros beyond the border also differ from the mean.
        let beyond = 1.0 - sum(&|_| 1.0);
        let variance_x = sum_x(&|i| (x[i] - mean_x).squared()) + R::of(beyond) * mean_x.squared();
        let variance_y = sum(&|i| (y[i] - mean_y).powi(2)) + beyond * mean_y * mean_y;
        let covariance = sum_x(&|i| (x[i] - mean_x) * R::of(y[i] - mean_y)) + R::of(beyond * mean_y) * mean_x;
        WindowMoments {
            mean_x,
            mean_y,
            variance_x,
            variance_y,
            covariance,
        }
    }

    fn ssim(&self) -> R {
        let of = R::of;
        let luminance = (of(2.0 * self.mean_y) * self.mean_x + of(C1))
            / (self.mean_x.squared() + of(self.mean_y * self.mean_y + C1));
        let structure = (of(2.0) * self.covariance + of(C2)) / (self.variance_x + of(self.variance_y + C2));
        luminance * structure
    }
}

impl WindowMoments<f64> {
    /// Derivatives of SSIM by the mean, variance and covariance of the image.
    fn slopes(&self) -> [f64; 3] {
        let variable = |value, index| Dual::<3>::variable(value, Some(index));
        let dual = WindowMoments {
            mean_x: variable(self.mean_x, 0),
            mean_y: self.mean_y,
            variance_x: variable(self.variance_x, 1),
            variance_y: self.variance_y,
            covariance: variable(self.covariance, 2),
        };
        dual.ssim().d
    }
}

/// SSIM of `x` against `y` at every pixel, rows of `width`.
pub fn ssim<R: Real>(width: usize, x: &[R], y: &[f64]) -> Vec<R> {
    let window = Window::new(width, x.len());
    (0..x.len())
        .into_par_iter()
        .map(|i| WindowMoments::under(&window.around(i), x, y).ssim())
        .collect()
}

/// Derivatives of `Σ upstream · ssim` by every pixel of `x`.
///
/// SSIM's partial derivatives are exact duals of its three moments; only their spreading over the window is written
/// out: `∂μ/∂x = g`, `∂σ²/∂x = 2g (x − μ)`, `∂cov/∂x = g (y − ν)`.
pub fn gradient(width: usize, x: &[f64], y: &[f64], upstream: &[f64]) -> Vec<f64> {
    let window = Window::new(width, x.len());
    let slopes: Vec<(WindowMoments<f64>, [f64; 3])> = (0..x.len())
        .into_par_iter()
        .map(|i| {
            let moments = WindowMoments::under(&window.around(i), x, y);
            (moments, moments.slopes().map(|slope| slope * upstream[i]))
        })
        .collect();
    let at = |i: usize| {
        let mut d = 0.0;
        for (j, g) in window.around(i) {
            let (moments, [by_mean, by_variance, by_covariance]) = &slopes[j];
            d += g * by_mean;
            d += 2.0 * g * (x[i] - moments.mean_x) * by_variance;
            d += g * (y[i] - moments.mean_y) * by_covariance;
        }
        d
    };
    (0..x.len()).into_par_iter().map(at).collect()
}
