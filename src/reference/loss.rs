//! The training loss: `(1 − λ) · L1 + λ · (1 − SSIM)`, each a mean over pixels and channels.
//!
//! Under a mask both are means weighted by it, and SSIM's windows see both images multiplied by it: masked pixels are
//! treated like pixels outside the image, and have no gradient. A mask of zeros gives loss 0.

use super::{Real, ssim};
use crate::scene::AlphaMode;

/// Share of D-SSIM in the loss (3DGS paper, section 7.1).
pub const LAMBDA: f64 = 0.2;

/// Photograph as the target of an image.
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

    fn weights(&self) -> Vec<f64> {
        (0..self.photo.len()).map(|i| self.weight(i)).collect()
    }

    /// One channel of the image and of the photograph, masked.
    fn channel<R: Real>(&self, image: &[[R; 3]], channel: usize) -> (Vec<R>, Vec<f64>) {
        let (pixels, photo) = (image.len(), self.photo.len());
        assert_eq!(pixels, photo, "image and photograph differ in size");
        let x = (0..pixels).map(|i| R::of(self.weight(i)) * image[i][channel]);
        let y = (0..pixels).map(|i| self.weight(i) * self.photo[i][channel]);
        (x.collect(), y.collect())
    }

    /// Divisor of the sums: total weight over pixels and channels.
    fn count(&self) -> f64 {
        3.0 * self.weights().iter().sum::<f64>()
    }
}

/// Values of a photograph's stored pixels: target colours, and weights if alpha is a mask.
pub fn values(rgba: &[[u8; 4]], mode: AlphaMode, background: [f64; 3]) -> (Vec<[f64; 3]>, Option<Vec<f64>>) {
    let share = |level: u8| f64::from(level) / 255.0;
    let colors = rgba.iter().map(|&[r, g, b, alpha]| {
        let stored = [r, g, b].map(share);
        match mode {
            AlphaMode::Mask => stored,
            AlphaMode::Composite => {
                [0, 1, 2].map(|channel| share(alpha) * stored[channel] + (1.0 - share(alpha)) * background[channel])
            }
        }
    });
    let weights = || rgba.iter().map(|pixel| share(pixel[3])).collect();
    (colors.collect(), (mode == AlphaMode::Mask).then(weights))
}

/// Sums over pixels and channels, weighted by the mask.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sums<R> {
    /// `|image − photo|`.
    pub l1: R,
    /// `1 − SSIM`.
    pub dissimilarity: R,
    /// `(image − photo)²`.
    pub squared: R,
    /// Sum of the weights: three times the number of pixels if there is no mask.
    pub weight: f64,
}

impl<R: Real> Sums<R> {
    /// The loss.
    pub fn loss(&self, lambda: f64) -> R {
        if self.weight == 0.0 {
            return R::of(0.0);
        }
        let sum = R::of(1.0 - lambda) * self.l1 + R::of(lambda) * self.dissimilarity;
        sum / R::of(self.weight)
    }
}

/// Sums over the image, from which the loss follows.
pub fn sums<R: Real>(image: &[[R; 3]], target: &Target<'_>) -> Sums<R> {
    let zero = R::of(0.0);
    let (mut l1, mut dissimilarity, mut squared) = (zero, zero, zero);
    for channel in 0..3 {
        let (x, y) = target.channel(image, channel);
        for (i, ssim) in ssim::ssim(target.width, &x, &y).into_iter().enumerate() {
            let weight = R::of(target.weight(i));
            let difference = image[i][channel] - R::of(target.photo[i][channel]);
            l1 = l1 + weight * difference.abs();
            squared = squared + weight * difference.squared();
            dissimilarity = dissimilarity + weight * (R::of(1.0) - ssim);
        }
    }
    Sums {
        l1,
        dissimilarity,
        squared,
        weight: target.count(),
    }
}

/// Loss of an image.
pub fn loss<R: Real>(image: &[[R; 3]], target: &Target<'_>) -> R {
    sums(image, target).loss(target.lambda)
}

/// Derivatives of the loss by every channel of every pixel.
pub fn gradient(image: &[[f64; 3]], target: &Target<'_>) -> Vec<[f64; 3]> {
    let mut d_image = vec![[0.0; 3]; image.len()];
    let count = target.count();
    if count == 0.0 {
        return d_image;
    }
    for channel in 0..3 {
        let (x, y) = target.channel(image, channel);
        let d_ssim = ssim::gradient(target.width, &x, &y, &target.weights());
        for (i, d) in d_image.iter_mut().enumerate() {
            let difference = image[i][channel] - target.photo[i][channel];
            let d_l1 = if difference == 0.0 { 0.0 } else { difference.signum() };
            let d_mixed = (1.0 - target.lambda) * d_l1 - target.lambda * d_ssim[i];
            d[channel] = target.weight(i) * d_mixed / count;
        }
    }
    d_image
}

/// Exposure of a photograph: gains of its channels in stored values, after the sRGB curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// 2^(e / 2.4) of each channel's exposure e in stops.
    pub gain: [f64; 3],
}

/// Offset of the sRGB curve (IEC 61966-2-1).
const CURVE_OFFSET: f64 = 0.055;

impl Exposure {
    /// Value of a channel under the exposure: on the curve, and on its toe, where those meet. Values that the
    /// photograph has clipped (levels 0, 1, 254 and 255) are bounds; towards a white one, a tenth of the distance
    /// counts beside.
    pub fn of<R: Real>(&self, channel: usize, value: R, photo: f64) -> R {
        let gain = self.gain[channel];
        let curve = R::of(gain) * (value + R::of(CURVE_OFFSET)) - R::of(CURVE_OFFSET);
        let toe = R::of(gain.powf(2.4)) * value;
        let is_lower = toe.value() < curve.value();
        let exposed = if is_lower == (gain >= 1.0) { toe } else { curve };
        match (photo * 255.0).round() {
            254.0.. => {
                let brighter = if exposed.value() < value.value() {
                    value
                } else {
                    exposed
                };
                brighter.at_most(photo) + R::of(0.1) * (value.at_most(photo) - R::of(photo))
            }
            ..=1.0 => exposed.at_least(photo),
            _ => exposed,
        }
    }

    /// The image under the exposure.
    pub fn image<R: Real>(&self, image: &[[R; 3]], photo: &[[f64; 3]]) -> Vec<[R; 3]> {
        let pixels = image.iter().zip(photo);
        pixels
            .map(|(x, y)| [0, 1, 2].map(|channel| self.of(channel, x[channel], y[channel])))
            .collect()
    }

    /// Sums for the gains that bring an image without exposure nearest to a photograph: products and squares of each
    /// channel, counted from the curve's offset, and their weight. `weight` is that of each pixel.
    pub fn sums(&self, image: &[[f64; 3]], photo: &[[f64; 3]], weight: impl Fn(usize) -> f64) -> [[f64; 4]; 2] {
        let mut sums = [[0.0; 4]; 2];
        let places = (0..image.len()).flat_map(|pixel| (0..3).map(move |channel| (pixel, channel)));
        for (pixel, channel) in places {
            let (x, y) = (image[pixel][channel], photo[pixel][channel]);
            if !(14.0..=252.0).contains(&(y * 255.0).round()) {
                continue;
            }
            let residual = (self.of(channel, x, y) - y).abs();
            let weight = weight(pixel) * if residual > 0.1 { 0.1 / residual } else { 1.0 };
            sums[0][channel] += weight * (x + CURVE_OFFSET) * (y + CURVE_OFFSET);
            sums[1][channel] += weight * (x + CURVE_OFFSET).powi(2);
            sums[0][3] += weight;
        }
        sums
    }
}

/// Sums over square patches, `edge` pixels along a side, in rows: weighted residuals of red, green and blue, image
/// minus photograph, and the weights.
pub fn residuals(image: &[[f64; 3]], target: &Target<'_>, edge: usize) -> Vec<[f64; 4]> {
    let columns = target.width.div_ceil(edge);
    let rows = (image.len() / target.width).div_ceil(edge);
    let mut sums = vec![[0.0; 4]; columns * rows];
    for (pixel, (x, y)) in image.iter().zip(target.photo).enumerate() {
        let (column, row) = (pixel % target.width / edge, pixel / target.width / edge);
        let (sums, weight) = (&mut sums[row * columns + column], target.weight(pixel));
        for channel in 0..3 {
            sums[channel] += weight * (x[channel] - y[channel]);
        }
        sums[3] += weight;
    }
    sums
}
