//! Scores of rendered views against their photographs.

use super::{Image, compare, mean_squared_error, ssim};
use crate::scene::{AlphaMode, Photo};
use serde::{Deserialize, Serialize};

/// Scores of a view. `psnr_db` and `ssim` compare float values, `…_8bit` both pictures rounded to 8 bits a channel; see
/// [`crate::metrics`]. A PSNR is `None` if it is not finite: without any error, or without any pixel that counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewScore {
    /// The photograph's name.
    pub name: String,
    /// Decibels, float values.
    pub psnr_db: Option<f64>,
    /// Structural similarity, float values.
    pub ssim: Option<f64>,
    /// Decibels, 8-bit values.
    pub psnr_db_8bit: Option<f64>,
    /// Structural similarity, 8-bit values.
    pub ssim_8bit: Option<f64>,
}

/// Means over views of each figure (decibels are averaged, not errors), each over the views that have it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeanScore {
    /// Number of views.
    pub views: usize,
    /// Decibels, float values.
    pub psnr_db: Option<f64>,
    /// Structural similarity, float values.
    pub ssim: Option<f64>,
    /// Decibels, 8-bit values.
    pub psnr_db_8bit: Option<f64>,
    /// Structural similarity, 8-bit values.
    pub ssim_8bit: Option<f64>,
}

impl MeanScore {
    /// The means of some views' scores.
    pub fn of(views: &[ViewScore]) -> MeanScore {
        let mean = |figure: fn(&ViewScore) -> Option<f64>| {
            let known: Vec<f64> = views.iter().filter_map(figure).collect();
            finite(known.iter().sum::<f64>() / known.len() as f64)
        };
        MeanScore {
            views: views.len(),
            psnr_db: mean(|v| v.psnr_db),
            ssim: mean(|v| v.ssim),
            psnr_db_8bit: mean(|v| v.psnr_db_8bit),
            ssim_8bit: mean(|v| v.ssim_8bit),
        }
    }
}

/// A photograph prepared for comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Colours `[row][column]`, 0 to 1.
    pub rgb: Vec<[f32; 3]>,
    /// Weight of each pixel, 0 to 1; `None`: all 1.
    pub weights: Option<Vec<f32>>,
}

impl Target {
    /// The photograph with its alpha channel composited over the background or made a mask.
    pub fn new(photo: &Photo, alpha: AlphaMode, background: [f32; 3]) -> Target {
        let unit = |byte: u8| f32::from(byte) / 255.0;
        let over_background = |&[r, g, b, a]: &[u8; 4]| {
            let (color, share) = ([r, g, b].map(unit), unit(a));
            [0, 1, 2].map(|c| color[c] * share + background[c] * (1.0 - share))
        };
        let as_stored = |&[r, g, b, _]: &[u8; 4]| [r, g, b].map(unit);
        let is_mask = alpha == AlphaMode::Mask;
        let has_alpha = photo.rgba.iter().any(|pixel| pixel[3] != 255);
        Target {
            width: photo.width,
            height: photo.height,
            rgb: match is_mask {
                true => photo.rgba.iter().map(as_stored).collect(),
                false => photo.rgba.iter().map(over_background).collect(),
            },
            weights: (is_mask && has_alpha).then(|| photo.rgba.iter().map(|pixel| unit(pixel[3])).collect()),
        }
    }

    /// SSIM of a rendering of the same size, `[row][column]`.
    pub fn ssim(&self, rendering: &[[f32; 3]]) -> f64 {
        let [rendered, photo] = self.images(rendering);
        ssim(rendered, photo, self.weights.as_deref())
    }

    /// Mean squared error of a rendering of the same size over pixels and channels.
    pub fn mean_squared_error(&self, rendering: &[[f32; 3]]) -> f64 {
        let [rendered, photo] = self.images(rendering);
        mean_squared_error(rendered, photo, self.weights.as_deref())
    }

    /// Rendering and photograph.
    fn images<'i>(&'i self, rendering: &'i [[f32; 3]]) -> [Image<'i>; 2] {
        [rendering, &self.rgb].map(|rgb| Image::new(self.width, self.height, rgb))
    }

    /// The score of a rendering of the same size, `[row][column]`.
    pub fn score(&self, name: &str, rendering: &[[f32; 3]]) -> ViewScore {
        let [rendered, photo] = self.images(rendering);
        let scores = compare(rendered, photo, self.weights.as_deref());
        ViewScore {
            name: name.to_string(),
            psnr_db: finite(scores.float.psnr_db),
            ssim: finite(scores.float.ssim),
            psnr_db_8bit: finite(scores.rounded.psnr_db),
            ssim_8bit: finite(scores.rounded.ssim),
        }
    }
}

fn finite(figure: f64) -> Option<f64> {
    figure.is_finite().then_some(figure)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photo(alpha: u8) -> Photo {
        Photo {
            width: 2,
            height: 1,
            rgba: vec![[255, 0, 51, 255], [255, 255, 255, alpha]],
        }
    }

    #[test]
    fn alpha_is_composited_or_weighs() {
        let over = Target::new(&photo(51), AlphaMode::Composite, [0.5, 0.0, 1.0]);
        assert_eq!(over.rgb[0], [1.0, 0.0, 0.2]);
        for (found, wanted) in over.rgb[1].iter().zip([0.6, 0.2, 1.0]) {
            assert!((found - wanted).abs() < 1e-6);
        }
        assert_eq!(over.weights, None);
        let mask = Target::new(&photo(51), AlphaMode::Mask, [0.0; 3]);
        assert_eq!(mask.rgb[1], [1.0; 3]);
        assert_eq!(mask.weights, Some(vec![1.0, 0.2]));
        assert_eq!(Target::new(&photo(255), AlphaMode::Mask, [0.0; 3]).weights, None);
    }

    #[test]
    fn scores_without_a_number_are_none_and_left_out_of_means() {
        let target = Target::new(&photo(255), AlphaMode::Composite, [0.0; 3]);
        let equal = target.score("equal", &target.rgb);
        assert_eq!((equal.psnr_db, equal.ssim), (None, Some(1.0)));
        let off: Vec<[f32; 3]> = target.rgb.iter().map(|c| c.map(|x| x + 0.1)).collect();
        let off = target.score("off", &off);
        let psnr = off.psnr_db.unwrap_or_default();
        assert!((psnr - 20.0).abs() < 1e-4, "{psnr}");
        let mean = MeanScore::of(&[equal, off]);
        assert_eq!((mean.views, mean.psnr_db), (2, Some(psnr)));
        assert_eq!(MeanScore::of(&[]), MeanScore::default());
        let none = MeanScore::default();
        let json = serde_json::to_string(&none).unwrap_or_default();
        assert_eq!(serde_json::from_str::<MeanScore>(&json).ok(), Some(none));
    }
}
