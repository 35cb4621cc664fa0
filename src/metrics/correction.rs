//! Affine correction of a rendering's colours to a photograph, and scores after it: the shape of a scene apart from the
//! exposure and white balance of the photograph.

use super::{Image, Target, psnr_db, ssim};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Weight of the distance to identity in the fit, relative to the sum of the pixels' weights: far below any residual,
/// and enough for a rendering of one colour.
const RIDGE: f64 = 1e-9;

/// Colour `A c + b`: 12 numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AffineCorrection {
    /// `[channel of the result]`: the row of A, and b.
    pub rows: [[f64; 4]; 3],
}

impl AffineCorrection {
    /// The colours as they are.
    pub const IDENTITY: AffineCorrection = AffineCorrection {
        rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    };

    /// Least squares from the rendering to the photograph, weighted by `weights` (0 to 1), direct: the residual is that
    /// of the corrected rendering. It never exceeds that of identity, which is among the candidates. Identity without
    /// any pixel that counts; not finite if such a pixel is not.
    pub fn fit(rendered: Image<'_>, photo: Image<'_>, weights: Option<&[f32]>) -> AffineCorrection {
        super::check(rendered, photo, weights);
        // Of the change from identity, so that the ridge is a plain one: Σ w |X d − (photo − rendered)|².
        let (mut normal, mut right, mut total) = ([[0.0; 4]; 4], [[0.0; 4]; 3], 0.0);
        for (i, (from, to)) in rendered.rgb.iter().zip(photo.rgb).enumerate() {
            let weight = weights.map_or(1.0, |weights| f64::from(weights[i]));
            if weight <= 0.0 {
                continue;
            }
            let [r, g, b] = from.map(f64::from);
            let x = [r, g, b, 1.0];
            for (row, xi) in normal.iter_mut().zip(x) {
                row.iter_mut().zip(x).for_each(|(sum, xj)| *sum += weight * xi * xj);
            }
            for (channel, sums) in right.iter_mut().enumerate() {
                let residual = f64::from(to[channel]) - f64::from(from[channel]);
                sums.iter_mut()
                    .zip(x)
                    .for_each(|(sum, xi)| *sum += weight * xi * residual);
            }
            total += weight;
        }
        if total == 0.0 {
            return AffineCorrection::IDENTITY;
        }
        (0..4).for_each(|i| normal[i][i] += RIDGE * total);
        let mut fitted = AffineCorrection::IDENTITY;
        for (row, change) in fitted.rows.iter_mut().zip(solved(normal, right)) {
            row.iter_mut().zip(change).for_each(|(value, d)| *value += d);
        }
        fitted
    }

    /// The corrected colour, clipped to 0 to 1; NaN stays NaN.
    pub fn apply(&self, color: [f32; 3]) -> [f32; 3] {
        let [r, g, b] = color.map(f64::from);
        let of = |[x, y, z, offset]: [f64; 4]| (x * r + y * g + z * b + offset).clamp(0.0, 1.0) as f32;
        self.rows.map(of)
    }
}

/// Solutions of `matrix x = right` for three right-hand sides, by Cholesky's decomposition.
fn solved(matrix: [[f64; 4]; 4], right: [[f64; 4]; 3]) -> [[f64; 4]; 3] {
    let mut lower = [[0.0; 4]; 4];
    for i in 0..4 {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - dot;
            lower[i][j] = match i == j {
                // Rounding alone can turn a pivot of the ridge's size negative.
                true => rest.max(f64::MIN_POSITIVE).sqrt(),
                false => rest / lower[j][j],
            };
        }
    }
    right.map(|mut x| {
        for i in 0..4 {
            let dot: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
            x[i] = (x[i] - dot) / lower[i][i];
        }
        for i in (0..4).rev() {
            let dot: f64 = (i + 1..4).map(|k| lower[k][i] * x[k]).sum();
            x[i] = (x[i] - dot) / lower[i][i];
        }
        x
    })
}

/// PSNR and SSIM of a corrected rendering, float values; `None` if not finite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CorrectedScore {
    /// Decibels.
    pub psnr_db: Option<f64>,
    /// Structural similarity.
    pub ssim: Option<f64>,
}

impl CorrectedScore {
    /// The means of some scores, each figure over those that have it.
    pub fn mean(of: impl Iterator<Item = CorrectedScore> + Clone) -> CorrectedScore {
        let mean = |figure: fn(CorrectedScore) -> Option<f64>| {
            let known: Vec<f64> = of.clone().filter_map(figure).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
        };
        CorrectedScore {
            psnr_db: mean(|score| score.psnr_db),
            ssim: mean(|score| score.ssim),
        }
    }
}

/// Scores of the halves of a picture, each corrected by the fit to the other: no pixel is used both ways.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HalfScores {
    /// Left half, under the correction fitted to the right one.
    pub left: CorrectedScore,
    /// Right half, under the correction fitted to the left one.
    pub right: CorrectedScore,
}

/// Scores of a view under affine corrections of 12 numbers, fitted by least squares from the rendering to the
/// photograph and clipped to 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CorrectedScores {
    /// Fitted to all pixels that are scored.
    pub cc_affine12_direct: CorrectedScore,
    /// Fitted to the other half.
    pub half_affine12_direct: HalfScores,
}

impl CorrectedScores {
    /// The means of views' scores, each figure over the views that have it.
    pub fn mean(views: &[CorrectedScores]) -> CorrectedScores {
        let mean = |part: fn(&CorrectedScores) -> CorrectedScore| CorrectedScore::mean(views.iter().map(part));
        CorrectedScores {
            cc_affine12_direct: mean(|view| view.cc_affine12_direct),
            half_affine12_direct: HalfScores {
                left: mean(|view| view.half_affine12_direct.left),
                right: mean(|view| view.half_affine12_direct.right),
            },
        }
    }
}

/// Columns of a rendering and its photograph.
struct ImageColumns {
    width: u32,
    height: u32,
    rendered: Vec<[f32; 3]>,
    photo: Vec<[f32; 3]>,
    weights: Option<Vec<f32>>,
}

impl ImageColumns {
    fn of(target: &Target, rendering: &[[f32; 3]], columns: Range<usize>) -> ImageColumns {
        fn cut<T: Copy>(values: &[T], width: usize, columns: &Range<usize>) -> Vec<T> {
            let rows = values.chunks_exact(width);
            rows.flat_map(|row| row[columns.clone()].iter().copied()).collect()
        }
        let width = target.width as usize;
        ImageColumns {
            width: columns.len() as u32,
            height: target.height,
            rendered: cut(rendering, width, &columns),
            photo: cut(&target.rgb, width, &columns),
            weights: target.weights.as_deref().map(|weights| cut(weights, width, &columns)),
        }
    }

    fn image<'a>(&self, rgb: &'a [[f32; 3]]) -> Image<'a> {
        Image::new(self.width, self.height, rgb)
    }

    fn fit(&self) -> AffineCorrection {
        let (from, to) = (self.image(&self.rendered), self.image(&self.photo));
        AffineCorrection::fit(from, to, self.weights.as_deref())
    }

    fn score(&self, correction: &AffineCorrection) -> CorrectedScore {
        let corrected: Vec<[f32; 3]> = self.rendered.iter().map(|&color| correction.apply(color)).collect();
        let (from, to) = (self.image(&corrected), self.image(&self.photo));
        let weights = self.weights.as_deref();
        let finite = |figure: f64| figure.is_finite().then_some(figure);
        CorrectedScore {
            psnr_db: finite(psnr_db(from, to, weights)),
            ssim: finite(ssim(from, to, weights)),
        }
    }
}

impl Target {
    /// Scores of a rendering of the same size, `[row][column]`, under corrections of its colours.
    pub fn corrected(&self, rendering: &[[f32; 3]]) -> CorrectedScores {
        let (width, middle) = (self.width as usize, self.width as usize / 2);
        let part = |columns| ImageColumns::of(self, rendering, columns);
        let (whole, left, right) = (part(0..width), part(0..middle), part(middle..width));
        CorrectedScores {
            cc_affine12_direct: whole.score(&whole.fit()),
            half_affine12_direct: HalfScores {
                left: left.score(&right.fit()),
                right: right.score(&left.fit()),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth colours with noise; `weights` leaves out a quarter of the picture.
    fn pair(width: u32, height: u32, noise: f32) -> (Target, Vec<[f32; 3]>) {
        let mut state = 7_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        let (mut photo, mut rendering, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
            let color = [0.2 + 0.6 * u, 0.8 - 0.5 * v, 0.3 + 0.4 * u * v];
            rendering.push(color.map(|c| c + noise * random()));
            photo.push(color);
            weights.push(if x < width / 2 && y < height / 2 { 0.0 } else { 1.0 });
        }
        let target = Target {
            width,
            height,
            rgb: photo,
            weights: Some(weights),
        };
        (target, rendering)
    }

    fn db(score: CorrectedScore) -> f64 {
        score.psnr_db.unwrap_or(f64::NAN)
    }

    #[test]
    fn a_correction_never_costs_decibels() {
        for (seed, noise) in [0.01, 0.1, 0.5, 2.0].into_iter().enumerate() {
            let (mut target, mut rendering) = pair(17 + seed as u32, 12, noise);
            // Pixels without weight must not pull the fit.
            for (color, weight) in rendering.iter_mut().zip(target.weights.iter().flatten()) {
                if *weight == 0.0 {
                    *color = [1e3, -1e3, f32::NAN];
                }
            }
            for _ in 0..2 {
                let raw = target.score("", &rendering).psnr_db.unwrap_or(f64::NAN);
                let corrected = db(target.corrected(&rendering).cc_affine12_direct);
                assert!(corrected >= raw - 1e-6, "{noise}: {corrected} dB, raw {raw} dB");
                // The second time without a mask.
                target.weights = None;
                rendering
                    .iter_mut()
                    .for_each(|c| *c = c.map(|x| if x.abs() < 100.0 { x } else { 0.5 }));
            }
        }
    }

    #[test]
    fn exposure_does_not_count() {
        let (target, rendering) = pair(40, 30, 0.05);
        let dark: Vec<[f32; 3]> = rendering.iter().map(|c| c.map(|x| 0.7 * x)).collect();
        let (raw, darker) = (target.score("", &rendering), target.score("", &dark));
        assert!(
            raw.psnr_db > darker.psnr_db.map(|db| db + 5.0),
            "the test tells nothing"
        );
        let (of, of_dark) = (target.corrected(&rendering), target.corrected(&dark));
        for part in [
            |s: &CorrectedScores| s.cc_affine12_direct,
            |s: &CorrectedScores| s.half_affine12_direct.left,
            |s: &CorrectedScores| s.half_affine12_direct.right,
        ] {
            let (a, b) = (db(part(&of)), db(part(&of_dark)));
            assert!((a - b).abs() < 0.01, "{a} dB, darker {b} dB");
        }
    }

    #[test]
    fn halves_are_fitted_to_each_other() {
        // The right half is a stop darker in the rendering alone: a fit to the left half cannot know it.
        let (mut target, rendering) = pair(40, 30, 0.0);
        target.weights = None;
        let half_dark: Vec<[f32; 3]> = rendering
            .iter()
            .enumerate()
            .map(|(i, c)| if i % 40 < 20 { *c } else { c.map(|x| 0.5 * x) })
            .collect();
        let scores = target.corrected(&half_dark).half_affine12_direct;
        let left_as_is = target.corrected(&rendering).half_affine12_direct;
        assert!(db(scores.right) < 15.0 && db(scores.left) < 15.0, "{scores:?}");
        assert!(left_as_is.right.psnr_db.is_none_or(|db| db > 60.0), "{left_as_is:?}");
    }

    #[test]
    fn a_picture_without_colours_or_pixels_is_no_trouble() {
        let (mut target, mut rendering) = pair(8, 6, 0.0);
        rendering.fill([0.25; 3]);
        let flat = target.corrected(&rendering).cc_affine12_direct;
        assert!(flat.psnr_db >= target.score("", &rendering).psnr_db, "{flat:?}");
        target.weights = Some(vec![0.0; 48]);
        let none = target.corrected(&rendering);
        assert_eq!(none, CorrectedScores::default());
        assert_eq!(CorrectedScores::mean(&[none]), CorrectedScores::default());
        target.weights = None;
        rendering[5] = [f32::NAN; 3];
        assert_eq!(target.corrected(&rendering).cc_affine12_direct.psnr_db, None);
    }
}
