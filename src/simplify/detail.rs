//! Detail of photographs that is lost at half size.

use crate::Result;
use crate::io::photo::{half, load, reduce};
use crate::metrics::{Image, Target, mean_squared_error};
use crate::scene::{AlphaMode, Dataset, Photo};
use crate::stats::mean;

/// Mean squared error between the views' photographs, as training compares with them, and their halves enlarged to full
/// size: the error of a scene fitted perfectly to the halves.
pub(super) fn lost_by_halving(dataset: &Dataset, views: &[usize], background: [f32; 3]) -> Result<f64> {
    let lost = |&view: &usize| {
        let photo = load(&dataset.views[view])?;
        Ok(lost(&photo, dataset.alpha, background))
    };
    let lost: Vec<f64> = views.iter().map(lost).collect::<Result<_>>()?;
    Ok(mean(&lost))
}

fn lost(photo: &Photo, alpha: AlphaMode, background: [f32; 3]) -> f64 {
    let [width, height] = [photo.width, photo.height].map(half);
    let whole = Target::new(photo, alpha, background);
    let halved = Target::new(&reduce(photo.clone(), width, height), alpha, background);
    let back = enlarged(&halved, [photo.width, photo.height]);
    let [a, b] = [&back, &whole.rgb].map(|rgb| Image::new(photo.width, photo.height, rgb));
    let lost = mean_squared_error(a, b, whole.weights.as_deref());
    // No pixel counts: no loss.
    if lost.is_finite() { lost } else { 0.0 }
}

/// A picture resized by bilinear interpolation between pixel centres, with the pixels' weights.
fn enlarged(from: &Target, [width, height]: [u32; 2]) -> Vec<[f32; 3]> {
    let (columns, rows) = (pairs(from.width, width), pairs(from.height, height));
    let pixel = |row: &LinearTap, column: &LinearTap| {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for (y, row_share) in row {
            for (x, column_share) in column {
                let index = y * from.width as usize + x;
                let counts = from.weights.as_ref().map_or(1.0, |weights| weights[index]);
                let share = row_share * column_share * counts;
                let color = from.rgb[index];
                (0..3).for_each(|c| sum[c] += share * color[c]);
                total += share;
            }
        }
        sum.map(|sum| if total > 0.0 { sum / total } else { 0.0 })
    };
    let row = |row| columns.iter().map(move |column| pixel(row, column));
    rows.iter().flat_map(row).collect()
}

/// Two neighbouring pixels, each with its weight.
type LinearTap = [(usize, f32); 2];

/// By pixel of the longer line, the two pixels of the shorter one around its centre.
fn pairs(short: u32, long: u32) -> Vec<LinearTap> {
    let step = f64::from(short) / f64::from(long);
    let last = f64::from(short.saturating_sub(1));
    let pair = |i: u32| {
        let at = ((f64::from(i) + 0.5) * step - 0.5).clamp(0.0, last);
        let (first, share) = (at.floor(), at.fract() as f32);
        let next = (first + 1.0).min(last);
        [(first as usize, 1.0 - share), (next as usize, share)]
    };
    (0..long).map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey photograph; `level` gives (grey, alpha) of each pixel.
    fn photo(width: u32, height: u32, level: impl Fn(u32, u32) -> [u8; 2]) -> Photo {
        let pixel = |i: u32| {
            let [level, alpha] = level(i % width, i / width);
            [level, level, level, alpha]
        };
        Photo {
            width,
            height,
            rgba: (0..width * height).map(pixel).collect(),
        }
    }

    fn lost(photo: &Photo, alpha: AlphaMode) -> f64 {
        super::lost(photo, alpha, [0.0; 3])
    }

    #[test]
    fn flat_photographs_lose_nothing_and_checkerboards_all_that_they_vary() {
        for [width, height] in [[16, 12], [15, 9], [2, 2], [1, 7]] {
            let flat = photo(width, height, |_, _| [77, 255]);
            assert!(lost(&flat, AlphaMode::Composite) < 1e-12);
        }
        let checkerboard = photo(16, 12, |x, y| [255 * ((x + y) % 2) as u8, 255]);
        // Half of the pixels are off by 127 or 128 of 255 either way.
        let variance = lost(&checkerboard, AlphaMode::Composite);
        assert!((variance - 0.25).abs() < 1e-4, "{variance}");
    }

    #[test]
    fn gradients_lose_little_and_fine_stripes_more_than_broad_ones() {
        let gradient = photo(64, 8, |x, _| [4 * x as u8, 255]);
        assert!(lost(&gradient, AlphaMode::Composite) < 1e-4);
        let stripes = |width: u32| {
            let stripes = photo(64, 64, |x, _| [200 * (x / width % 2) as u8, 255]);
            lost(&stripes, AlphaMode::Composite)
        };
        assert!(stripes(1) > 2.0 * stripes(4) && stripes(4) > 2.0 * stripes(16));
    }

    #[test]
    fn what_does_not_count_is_not_lost() {
        let masked = |level: u8| photo(16, 16, move |x, _| if x < 7 { [level, 0] } else { [90, 255] });
        assert!(lost(&masked(255), AlphaMode::Mask) < 1e-12);
        // Composited over a background, the mask's edge counts.
        assert!(lost(&masked(255), AlphaMode::Composite) > 1e-3);
        let nothing = photo(4, 4, |_, _| [9, 0]);
        assert_eq!(lost(&nothing, AlphaMode::Mask), 0.0);
    }
}
