//! Scalar renderer on the processor: rayon over rows, one pixel at a time, `f32`, the library's `exp` for every pair
//! of a pixel and a splat on its tile's list (3DGS paper, section 6).

use crate::lab::bench::input::lists::Lists;
use crate::lab::bench::input::pack::Splat2d;
use crate::lab::bench::kernels::Composite;
use crate::layout::{ALPHA_MAX, BASELINE_TILE};
use crate::reference::Thresholds;
use rayon::prelude::*;

/// A splat by the inverse of its covariance.
#[derive(Clone, Copy, Debug)]
struct Conic {
    mean: [f32; 2],
    /// xx, xy, yy; px^-2.
    inverse: [f32; 3],
    opacity: f32,
    color: [f32; 3],
}

impl Conic {
    fn of(record: &Splat2d) -> Conic {
        let [mean_x, mean_y, slope, log2_opacity] = record.shape;
        let [p, q, red, green] = record.tone;
        // The exponent is -(p dx)^2 - (q (dy - slope dx))^2 in base 2; in base e it is half the quadratic form.
        let twice = 2.0 * std::f32::consts::LN_2;
        Conic {
            mean: [mean_x, mean_y],
            inverse: [
                twice * (p * p + q * q * slope * slope),
                -twice * q * q * slope,
                twice * q * q,
            ],
            opacity: log2_opacity.exp2(),
            color: [red, green, record.rest[0]],
        }
    }

    /// Offset of a pixel's centre, and the raw alpha there.
    fn alpha(&self, x: usize, y: usize) -> ([f32; 2], f32) {
        let (dx, dy) = (x as f32 + 0.5 - self.mean[0], y as f32 + 0.5 - self.mean[1]);
        let [xx, xy, yy] = self.inverse;
        let power = -0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy;
        ([dx, dy], self.opacity * power.exp())
    }
}

/// Width and height of a tile, pixels.
pub(super) const TILE: usize = BASELINE_TILE as usize;

/// Input of the renderers on the processor: lists by square tiles.
pub struct HostInput<'a> {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Projected splats, and ranges of `splat_from_isect`.
    pub lists: &'a Lists,
    /// Nearest first in each tile.
    pub splat_from_isect: Vec<u32>,
    /// The same splats for the scalar renderer.
    conics: Vec<Conic>,
    /// Background colour.
    pub background: [f32; 3],
}

impl<'a> HostInput<'a> {
    /// Input from a composite with square tiles.
    pub fn new(composite: &'a Composite) -> HostInput<'a> {
        let lists = &composite.lists;
        let grid = &lists.grid;
        assert_eq!(
            [grid.tile_width, grid.tile_height].map(|side| side as usize),
            [TILE; 2],
            "square tiles"
        );
        HostInput {
            size: [grid.width as usize, grid.height as usize],
            lists,
            splat_from_isect: lists.splat_from_isect(),
            conics: lists.records.iter().map(Conic::of).collect(),
            background: composite.scene.options.background.map(|c| c as f32),
        }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// List of a tile, and its first index.
    pub fn list(&self, tile: usize) -> (&[u32], u32) {
        let [begin, end] = self.lists.range_from_tile[tile];
        (&self.splat_from_isect[begin as usize..end as usize], begin)
    }

    fn tile_at(&self, x: usize, y: usize) -> usize {
        y / TILE * self.size[0].div_ceil(TILE) + x / TILE
    }
}

/// Transmittance below which a pixel is done.
pub(super) const T_MIN: f32 = Thresholds::ENGINE.transmittance_min as f32;

/// Alpha below which a splat is left out of a pixel.
const ALPHA_MIN: f32 = Thresholds::ENGINE.alpha_min as f32;

/// Red, green, blue, transmittance of every pixel, and one past the last intersection that counts for it.
pub fn forward(input: &HostInput<'_>) -> (Vec<[f32; 4]>, Vec<u32>) {
    let width = input.size[0];
    let mut image = vec![[0.0; 4]; input.pixels()];
    let mut ends = vec![0; input.pixels()];
    let rows = image.par_chunks_mut(width).zip(ends.par_chunks_mut(width));
    rows.enumerate().for_each(|(y, (row, ends))| {
        for x in 0..width {
            (row[x], ends[x]) = pixel(input, x, y);
        }
    });
    (image, ends)
}

fn pixel(input: &HostInput<'_>, x: usize, y: usize) -> ([f32; 4], u32) {
    let (list, begin) = input.list(input.tile_at(x, y));
    let (mut rgb, mut transmittance, mut end) = ([0.0; 3], 1.0, 0);
    for (i, &splat) in list.iter().enumerate() {
        if transmittance < T_MIN {
            break;
        }
        let splat = &input.conics[splat as usize];
        let (_, raw) = splat.alpha(x, y);
        if raw < ALPHA_MIN {
            continue;
        }
        let alpha = raw.min(ALPHA_MAX);
        let weight = alpha * transmittance;
        for (sum, channel) in rgb.iter_mut().zip(splat.color) {
            *sum += weight * channel;
        }
        transmittance *= 1.0 - alpha;
        end = begin + i as u32 + 1;
    }
    for (sum, behind) in rgb.iter_mut().zip(input.background) {
        *sum += transmittance * behind;
    }
    ([rgb[0], rgb[1], rgb[2], transmittance], end)
}

/// Nine sums of every splat: with `s = alpha dL/d alpha` and the distance d from the centre in pixels, those of s,
/// s dx, s dy, s dx², s dx dy, s dy² and of the blending weight times the upstream gradient. That gradient is
/// laid out by `[channel][pixel]`; image and list ends are those of the forward pass. Every thread has sums of its own,
/// added up at the end.
pub fn backward(input: &HostInput<'_>, image: &[[f32; 4]], ends: &[u32], d_image: &[f32]) -> Vec<f32> {
    let threads = rayon::current_num_threads();
    let empty = || vec![0.0f32; 9 * input.lists.records.len()];
    (0..threads)
        .into_par_iter()
        .map(|thread| {
            let mut sums = empty();
            for y in (thread..input.size[1]).step_by(threads) {
                for x in 0..input.size[0] {
                    let at = y * input.size[0] + x;
                    let d = [0, 1, 2].map(|channel| d_image[channel * input.pixels() + at]);
                    pixel_backward(input, [x, y], image[at][3], ends[at], d, &mut sums);
                }
            }
            sums
        })
        .reduce(empty, |mut all, part| {
            all.iter_mut().zip(part).for_each(|(sum, term)| *sum += term);
            all
        })
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn pixel_backward(
    input: &HostInput<'_>,
    [x, y]: [usize; 2],
    mut transmittance: f32,
    end: u32,
    d: [f32; 3],
    sums: &mut [f32],
) {
    let (list, begin) = input.list(input.tile_at(x, y));
    let mut behind = dot(d, input.background);
    for &index in list[..end.saturating_sub(begin) as usize].iter().rev() {
        let splat = &input.conics[index as usize];
        let ([dx, dy], raw) = splat.alpha(x, y);
        if raw < ALPHA_MIN {
            continue;
        }
        let alpha = raw.min(ALPHA_MAX);
        transmittance /= 1.0 - alpha;
        let weight = alpha * transmittance;
        let ahead = dot(d, splat.color);
        // A capped alpha has no gradient.
        let s = if raw < ALPHA_MAX {
            weight * (ahead - behind)
        } else {
            0.0
        };
        behind += alpha * (ahead - behind);
        let terms = [
            s,
            s * dx,
            s * dy,
            s * dx * dx,
            s * dx * dy,
            s * dy * dy,
            weight * d[0],
            weight * d[1],
            weight * d[2],
        ];
        let row = &mut sums[9 * index as usize..][..9];
        row.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
    }
}

/// Sums of [`backward`] as in the kernels, by whitened residuals (see `pack::whitened_sums`).
pub fn whitened(input: &HostInput<'_>, sums: &[f32]) -> Vec<f32> {
    let rows = input.lists.records.iter().zip(sums.chunks_exact(9));
    let whiten = |(record, row): (&Splat2d, &[f32])| -> [f32; 9] {
        let [slope, p, q] = [record.shape[2], record.tone[0], record.tone[1]].map(f64::from);
        let sum = |i: usize| f64::from(row[i]);
        let moved = [
            sum(0),
            p * sum(1),
            q * (sum(2) - slope * sum(1)),
            p * p * sum(3),
            p * q * (sum(4) - slope * sum(3)),
            q * q * (sum(5) - 2.0 * slope * sum(4) + slope * slope * sum(3)),
            sum(6),
            sum(7),
            sum(8),
        ];
        // Splats outside the image have zero sums, and their shape may not be finite.
        moved.map(|x| if sum(0) == 0.0 && !x.is_finite() { 0.0 } else { x as f32 })
    };
    rows.flat_map(whiten).collect()
}
