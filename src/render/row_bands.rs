//! Row bands: parts of a picture with more pixels than one binding of the device holds.
//!
//! Each band is drawn as a picture of its own, of whole rows of tiles, with the numbers of the whole picture: its
//! pixels have the same bits.

use super::memory::isects_expected;
use crate::gpu::Caps;
use crate::kernels::rasterize::Outputs;
use crate::layout::{LOSS_TILE_HEIGHT, SURFACE_PLANES, TILE_HEIGHT, View};

/// Rows of a picture that are drawn at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowBand {
    /// First drawn row of the picture, a multiple of the tiles' height.
    pub first: u32,
    /// Number of drawn rows.
    pub rows: u32,
    /// Drawn rows that count, from the first drawn one on: begin and end. The others are a halo.
    pub counted: [u32; 2],
}

impl RowBand {
    /// The view of these rows of the picture.
    pub fn view(&self, whole: &View) -> View {
        View {
            size: [whole.size[0], self.rows],
            tiles: [whole.tiles[0], self.rows.div_ceil(TILE_HEIGHT)],
            first_row: self.first,
            ..*whole
        }
    }
}

/// Division of a picture into bands of rows; each row counts in one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowBands {
    size: [u32; 2],
    /// Counted rows of all bands but the last.
    step: u32,
    /// Drawn rows above and below those.
    halo: u32,
}

impl RowBands {
    /// Bands of a photograph to train on, whose largest array has so many bytes per pixel. SSIM's gradient by a pixel
    /// reaches 10 rows, less than a tile.
    pub fn for_training(size: [u32; 2], pixel_bytes: u64, binding: u64) -> RowBands {
        RowBands::within(size, binding / pixel_bytes, [LOSS_TILE_HEIGHT, TILE_HEIGHT])
    }

    /// Bands of a picture with these outputs, without halos.
    pub fn for_drawing(size: [u32; 2], outputs: Outputs, binding: u64) -> RowBands {
        let planes = if outputs.surface { SURFACE_PLANES } else { 4 };
        RowBands::within(size, binding / (4 * u64::from(planes)), [TILE_HEIGHT, 0])
    }

    /// The largest bands that fit, these or smaller ones, of a picture drawn without halos; these if none fit.
    pub(crate) fn while_drawing(self, fits: impl Fn(RowBands) -> bool) -> RowBands {
        let pixels = |units: u32| u64::from(self.size[0]) * u64::from(TILE_HEIGHT * units);
        let smaller = (1..self.step.div_ceil(TILE_HEIGHT)).rev();
        let smaller = smaller.map(|units| RowBands::within(self.size, pixels(units), [TILE_HEIGHT, 0]));
        let mut all = std::iter::once(self).chain(smaller);
        all.find(|&bands| fits(bands)).unwrap_or(self)
    }

    /// Drawn pixels of a band to train on in smaller bands than these, from the most on.
    pub fn fewer_pixels(self) -> impl Iterator<Item = u64> {
        let width = u64::from(self.size[0]);
        let smaller = (1..self.step.div_ceil(LOSS_TILE_HEIGHT)).rev();
        smaller.map(move |units| width * u64::from(LOSS_TILE_HEIGHT * units + 2 * TILE_HEIGHT))
    }

    /// Bands of at most so many drawn pixels, but of at least `unit` counted rows, in multiples of that.
    fn within(size: [u32; 2], pixels: u64, [unit, halo]: [u32; 2]) -> RowBands {
        let [width, height] = size.map(u64::from);
        let most = pixels / width.max(1);
        if height <= most {
            return RowBands {
                size,
                step: size[1].max(1),
                halo: 0,
            };
        }
        let unit = u64::from(unit);
        let units = (most.saturating_sub(2 * u64::from(halo)) / unit).max(1);
        // Bands of about equal heights.
        let count = height.div_ceil(units * unit);
        let step = height.div_ceil(count).div_ceil(unit) * unit;
        RowBands {
            size,
            step: step as u32,
            halo,
        }
    }

    /// Number of bands.
    pub fn count(&self) -> u32 {
        self.size[1].div_ceil(self.step).max(1)
    }

    /// The bands, from the top.
    pub fn each(self) -> impl Iterator<Item = RowBand> {
        let height = self.size[1];
        (0..self.count()).map(move |index| {
            let (begin, end) = (index * self.step, height.min((index + 1) * self.step));
            let first = begin.saturating_sub(self.halo);
            RowBand {
                first,
                rows: height.min(end + self.halo) - first,
                counted: [begin - first, end - first],
            }
        })
    }

    /// Estimated (splat, tile) pairs of the largest band.
    pub fn pairs_expected(&self, splats: usize) -> usize {
        let [width, height] = self.size;
        let all = isects_expected(splats, width, height);
        match self.count() {
            1 => all,
            _ => (all as f64 * f64::from(self.drawn()[1]) / f64::from(height)) as usize,
        }
    }

    /// Width and height of the largest drawn part.
    pub fn drawn(&self) -> [u32; 2] {
        let rows = self.each().map(|band| band.rows).max();
        [self.size[0], rows.unwrap_or(0)]
    }
}

/// Largest range of a binding, bytes.
pub fn binding_limit(caps: &Caps) -> u64 {
    caps.reach()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_count_each_row_once_and_stay_within_the_binding() {
        for size in [[8192, 5464], [4000, 3000], [48, 250], [100, 1], [7, 97]] {
            for pixels in [800, 7_281, 300_000, 3_728_270, u64::MAX] {
                let bands = RowBands::within(size, pixels, [48, 16]);
                let mut next = 0;
                for band in bands.each() {
                    assert_eq!((band.first % 16, band.first + band.counted[0]), (0, next));
                    next = band.first + band.counted[1];
                    let halo = (band.first + band.rows).abs_diff(next);
                    assert!(halo == 16 || band.first + band.rows == size[1], "{band:?}");
                    assert!(next % 48 == 0 || next == size[1], "{band:?}");
                }
                assert_eq!(next, size[1]);
                let fits = u64::from(size[0]) * u64::from(size[1]) <= pixels;
                assert_eq!(fits, bands.count() == 1 && bands.halo == 0, "{size:?}, {pixels}");
                let [width, rows] = bands.drawn();
                assert!(rows <= 80 || u64::from(width * rows) <= pixels, "{bands:?}");
            }
        }
    }
}
