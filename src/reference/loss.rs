//! The training loss: `(1 − λ) · L1 + λ · (1 − SSIM)`, each a mean over pixels and channels.
//!
//! SSIM: an 11 × 11 Gaussian window of σ = 1.5 px, the image continued by zeros, C₁ = 0.01²,
//! C₂ = 0.03² (Wang et al. 2004), one value per pixel and channel. Here the window is a plain double sum
//! and variances are centred sums, `Σ g (x − μ)²`, which cannot turn negative.
//!
//! A mask multiplies both images before anything else happens: a pixel of weight 0 has no gradient at all,
//! not even through its neighbours' windows. The means stay means over all pixels.

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
/// Share of D-SSIM in the loss (3DGS paper, section 7.1).
pub const LAMBDA: f64 = 0.2;

/// The photograph that an image is compared with.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// Width in pixels.
    pub width: usize,
    /// `[y * width + x]`, rgb, 0 to 1.
    pub photo: &'a [[f64; 3]],
    /// Weight of each pixel, 0 to 1.
    pub mask: Option<&'a [f64]>,
    /// Share of D-SSIM.
    pub lambda: f64,
}

impl<'a> Target<'a> {
    /// An unmasked photograph, with the usual share of D-SSIM.
    pub fn new(width: usize, photo: &'a [[f64; 3]]) -> Target<'a> {
        Target {
            width,
            photo,
            mask: None,
            lambda: LAMBDA,
        }
    }

    fn weight(&self, index: usize) -> f64 {
        self.mask.map_or(1.0, |mask| mask[index])
    }

    /// One channel of the image and of the photograph, masked.
    fn channel<R: Real>(&self, image: &[[R; 3]], channel: usize) -> (Vec<R>, Vec<f64>) {
        let (pixels, photo) = (image.len(), self.photo.len());
        assert_eq!(pixels, photo, "image and photograph differ in size");
        let x = (0..pixels).map(|i| R::of(self.weight(i)) * image[i][channel]);
        let y = (0..pixels).map(|i| self.weight(i) * self.photo[i][channel]);
        (x.collect(), y.collect())
    }
}

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

    /// The pixels of the image that the window around `index` covers, with their weights.
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

/// What SSIM is made of at one pixel.
#[derive(Clone, Copy)]
struct Moments<R> {
    mean_x: R,
    mean_y: f64,
    variance_x: R,
    variance_y: f64,
    covariance: R,
}

impl<R: Real> Moments<R> {
    fn under(window: &[(usize, f64)], x: &[R], y: &[f64]) -> Moments<R> {
        let sum = |f: &dyn Fn(usize) -> f64| window.iter().map(|&(i, g)| g * f(i)).sum::<f64>();
        let sum_x =
            |f: &dyn Fn(usize) -> R| window.iter().map(|&(i, g)| R::of(g) * f(i)).sum::<R>();
        let mean_x = sum_x(&|i| x[i]);
        let mean_y = sum(&|i| y[i]);
        // Beyond the border there are zeros, and they differ from the mean too.
        let beyond = 1.0 - sum(&|_| 1.0);
        let variance_x = sum_x(&|i| (x[i] - mean_x).squared()) + R::of(beyond) * mean_x.squared();
        let variance_y = sum(&|i| (y[i] - mean_y).powi(2)) + beyond * mean_y * mean_y;
        let covariance =
            sum_x(&|i| (x[i] - mean_x) * R::of(y[i] - mean_y)) + R::of(beyond * mean_y) * mean_x;
        Moments {
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
        let structure =
            (of(2.0) * self.covariance + of(C2)) / (self.variance_x + of(self.variance_y + C2));
        luminance * structure
    }
}

/// SSIM of one channel at every pixel.
pub fn ssim_map<R: Real>(width: usize, x: &[R], y: &[f64]) -> Vec<R> {
    let window = Window::new(width, x.len());
    (0..x.len())
        .into_par_iter()
        .map(|i| Moments::under(&window.around(i), x, y).ssim())
        .collect()
}

/// The two means that the loss mixes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts<R> {
    /// Mean absolute difference.
    pub l1: R,
    /// Mean SSIM.
    pub ssim: R,
}

impl<R: Real> Parts<R> {
    /// `(1 − λ) · L1 + λ · (1 − SSIM)`.
    pub fn loss(&self, lambda: f64) -> R {
        R::of(1.0 - lambda) * self.l1 + R::of(lambda) * (R::of(1.0) - self.ssim)
    }
}

/// L1 and SSIM of an image against the target.
pub fn parts<R: Real>(image: &[[R; 3]], target: &Target<'_>) -> Parts<R> {
    let count = R::of((image.len() * 3) as f64);
    let (mut l1, mut ssim) = (R::of(0.0), R::of(0.0));
    for channel in 0..3 {
        let (x, y) = target.channel(image, channel);
        l1 += x.iter().zip(&y).map(|(x, y)| (*x - R::of(*y)).abs()).sum();
        ssim += ssim_map(target.width, &x, &y).into_iter().sum();
    }
    Parts {
        l1: l1 / count,
        ssim: ssim / count,
    }
}

/// The loss of an image.
pub fn loss<R: Real>(image: &[[R; 3]], target: &Target<'_>) -> R {
    parts(image, target).loss(target.lambda)
}

/// The derivatives of the loss by every channel of every pixel.
///
/// SSIM's own partial derivatives are exact duals of its three moments; only their spreading over the window
/// is written out: `∂μ/∂x = g`, `∂σ²/∂x = 2g (x − μ)`, `∂cov/∂x = g (y − ν)`.
pub fn gradient(image: &[[f64; 3]], target: &Target<'_>) -> Vec<[f64; 3]> {
    let window = Window::new(target.width, image.len());
    let per_value = 1.0 / (image.len() * 3) as f64;
    let mut d_image = vec![[0.0; 3]; image.len()];
    for channel in 0..3 {
        let (x, y) = target.channel(image, channel);
        let slopes: Vec<(Moments<f64>, [f64; 3])> = (0..x.len())
            .into_par_iter()
            .map(|i| {
                let moments = Moments::under(&window.around(i), &x, &y);
                (moments, ssim_slopes(&moments))
            })
            .collect();
        d_image.par_iter_mut().enumerate().for_each(|(i, d)| {
            let mut d_ssim = 0.0;
            for (j, g) in window.around(i) {
                let (moments, [by_mean, by_variance, by_covariance]) = &slopes[j];
                d_ssim += g * by_mean;
                d_ssim += 2.0 * g * (x[i] - moments.mean_x) * by_variance;
                d_ssim += g * (y[i] - moments.mean_y) * by_covariance;
            }
            let difference = x[i] - y[i];
            let d_l1 = if difference == 0.0 {
                0.0
            } else {
                difference.signum()
            };
            let d_x = (1.0 - target.lambda) * d_l1 - target.lambda * d_ssim;
            d[channel] = target.weight(i) * per_value * d_x;
        });
    }
    d_image
}

/// Derivatives of SSIM by the mean, variance and covariance of the image.
fn ssim_slopes(moments: &Moments<f64>) -> [f64; 3] {
    let variable = |value, index| Dual::<3>::variable(value, Some(index));
    let dual = Moments {
        mean_x: variable(moments.mean_x, 0),
        mean_y: moments.mean_y,
        variance_x: variable(moments.variance_x, 1),
        variance_y: moments.variance_y,
        covariance: variable(moments.covariance, 2),
    };
    dual.ssim().d
}
