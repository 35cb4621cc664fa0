//! PSNR and SSIM between a rendering and a photograph, on float images and on 8-bit ones.
//!
//! Both are computed over the three colour channels of display-referred values, as stored in the photograph (0 to 1,
//! not linearised). All sums are `f64`, in an order independent of the number of threads.
//!
//! The float figures rate the rendering unclamped; the 8-bit figures rate the picture of a viewer or PNG file, each
//! channel clamped and rounded half up to one of 256 levels. A NaN pixel makes the figures NaN.
//!
//! **Invariant:** works on plain images, without files or devices.

mod correction;
mod psnr;
mod score;
mod ssim;

#[cfg(test)]
mod tests;

pub use correction::{AffineCorrection, CorrectedScore, CorrectedScores, HalfScores};
pub use psnr::{mean_squared_error, psnr_db};
pub use score::{MeanScore, Target, ViewScore};
pub use ssim::ssim;

use crate::scene::Photo;

/// A borrowed RGB image.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    width: usize,
    height: usize,
    rgb: &'a [[f32; 3]],
}

impl<'a> Image<'a> {
    /// `width * height` colours, `[row][column]`, rows from the top.
    pub fn new(width: u32, height: u32, rgb: &'a [[f32; 3]]) -> Image<'a> {
        let (width, height) = (width as usize, height as usize);
        assert_eq!(rgb.len(), width * height, "{width} × {height} colours");
        Image { width, height, rgb }
    }

    /// The image rounded to 8 bits a channel, as values of 0 to 1; NaN stays NaN.
    fn rounded(&self) -> Vec<[f32; 3]> {
        let round = |value: f32| match value.is_nan() {
            true => value,
            false => f32::from(Photo::level(value)) / 255.0,
        };
        self.rgb.iter().map(|c| c.map(round)).collect()
    }
}

/// Asserts equal sizes of two images and of the pixels' weights.
fn check(a: Image<'_>, b: Image<'_>, weights: Option<&[f32]>) {
    assert_eq!((a.width, a.height), (b.width, b.height), "image sizes");
    if let Some(weights) = weights {
        assert_eq!(weights.len(), a.rgb.len(), "one weight a pixel");
    }
}

/// PSNR and SSIM of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Peak signal-to-noise ratio in decibels, peak 1; infinite for equal images.
    pub psnr_db: f64,
    /// Structural similarity, 1 for equal images.
    pub ssim: f64,
}

/// Scores of an image as rendered, and rounded to 8 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scores {
    /// Float values, unclamped.
    pub float: Score,
    /// Both images rounded to 8 bits a channel.
    pub rounded: Score,
}

/// Scores `rendered` against `photo`. `weights` is a mask or a coverage of each pixel, 0 to 1: it weighs the squared
/// errors and the values of the SSIM map; the SSIM windows still cover every pixel.
pub fn compare(rendered: Image<'_>, photo: Image<'_>, weights: Option<&[f32]>) -> Scores {
    let score = |a, b| Score {
        psnr_db: psnr_db(a, b, weights),
        ssim: ssim(a, b, weights),
    };
    let (a, b) = (rendered.rounded(), photo.rounded());
    let rounded = |rgb| Image { rgb, ..rendered };
    Scores {
        float: score(rendered, photo),
        rounded: score(rounded(&a), rounded(&b)),
    }
}

/// Σ weight · value / Σ weight over pixels, in pixel order; NaN if no pixel has weight. The value of a pixel without
/// weight does not count, even if NaN.
fn weighted_mean(values: &[f64], weights: Option<&[f32]>) -> f64 {
    let Some(weights) = weights else {
        return values.iter().sum::<f64>() / values.len() as f64;
    };
    let (mut sum, mut total) = (0.0, 0.0);
    for (value, &weight) in values.iter().zip(weights) {
        if weight > 0.0 {
            sum += f64::from(weight) * value;
            total += f64::from(weight);
        }
    }
    sum / total
}
