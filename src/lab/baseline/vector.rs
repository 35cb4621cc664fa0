//! Vectorised renderer on the processor: splat after splat over the pixels of a tile, without rows outside the splat's
//! extent, with a branchless exponential. For builds with `-C target-cpu=native`.

use super::scalar::{HostInput, T_MIN, TILE};
use crate::lab::bench::input::pack::Splat2d;
use crate::layout::{ALPHA_MAX, LOG2_255};
use rayon::prelude::*;

/// Splats between two checks for a finished tile.
const BATCH: usize = 16;

/// One value per pixel of a tile's row.
type TileRow = [f32; TILE];

/// A tile's pixels: red, green, blue, transmittance.
struct Tile([[TileRow; 4]; TILE]);

/// Red, green, blue, transmittance of every pixel, `[pixel]`.
pub fn forward(input: &HostInput<'_>) -> Vec<[f32; 4]> {
    let [width, height] = input.size;
    let columns = width.div_ceil(TILE);
    let tiles: Vec<Tile> = (0..columns * height.div_ceil(TILE))
        .into_par_iter()
        .map(|tile| composite(input, tile, columns))
        .collect();
    let mut image = vec![[0.0; 4]; input.pixels()];
    image.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let planes = &tiles[y / TILE * columns + x / TILE].0[y % TILE];
            let [r, g, b, through] = [0, 1, 2, 3].map(|plane: usize| planes[plane][x % TILE]);
            let behind = input.background.map(|c| c * through);
            *pixel = [r + behind[0], g + behind[1], b + behind[2], through];
        }
    });
    image
}

fn composite(input: &HostInput<'_>, tile: usize, columns: usize) -> Tile {
    let corner = [tile % columns * TILE, tile / columns * TILE].map(|at| at as f32);
    let mut pixels = Tile([[[0.0; TILE], [0.0; TILE], [0.0; TILE], [1.0; TILE]]; TILE]);
    let (list, _) = input.list(tile);
    for batch in list.chunks(BATCH) {
        let alive = |row: &[TileRow; 4]| row[3].iter().any(|&t| t >= T_MIN);
        if !pixels.0.iter().any(alive) {
            break;
        }
        for &splat in batch {
            add(&mut pixels, &input.lists.records[splat as usize], corner);
        }
    }
    pixels
}

/// Blends a splat behind a tile's earlier splats, row by row.
fn add(pixels: &mut Tile, splat: &Splat2d, corner: [f32; 2]) {
    let [mean_x, mean_y, slope, top] = splat.shape;
    let [scale_x, scale_y, red, green] = splat.tone;
    let blue = splat.rest[0];
    let (mean_x, mean_y) = (mean_x - corner[0], mean_y - corner[1]);
    // The x terms of the exponent and of the residual in y are the same in every row.
    let (mut limit, mut shift) = ([0.0; TILE], [0.0; TILE]);
    for x in 0..TILE {
        let dx = x as f32 + 0.5 - mean_x;
        limit[x] = top - (dx * scale_x) * (dx * scale_x);
        shift[x] = (mean_y + slope * dx) * scale_y;
    }
    // Half height of the ellipse, from the variance of y: that at fixed x plus that by the slope.
    let level = (top + LOG2_255).max(0.0);
    let half = (level * (1.0 / (scale_y * scale_y) + slope * slope / (scale_x * scale_x))).sqrt();
    let first = (mean_y - half - 0.5).floor().max(0.0) as usize;
    let end = ((mean_y + half + 0.5).ceil().max(0.0) as usize).min(TILE);
    for (y, planes) in pixels.0.iter_mut().enumerate().take(end).skip(first) {
        let at = (y as f32 + 0.5) * scale_y;
        let [reds, greens, blues, through] = planes;
        for x in 0..TILE {
            let f = at - shift[x];
            let exponent = limit[x] - f * f;
            let before = through[x];
            let on = exponent >= -LOG2_255 && before >= T_MIN;
            // Far outside, the exponential may be wrong: it is not used.
            let alpha = exp2(exponent.max(-126.0)).min(ALPHA_MAX);
            let alpha = if on { alpha } else { 0.0 };
            let weight = alpha * before;
            reds[x] += weight * red;
            greens[x] += weight * green;
            blues[x] += weight * blue;
            through[x] = before * (1.0 - alpha);
        }
    }
}

/// 2^x for x from −126 to 127: the integer part goes into the exponent's bits, the rest into a polynomial of degree 5,
/// fitted at the Chebyshev nodes of [−½, ½] to a relative error of 1.1e-7.
fn exp2(x: f32) -> f32 {
    // Adding 1.5 · 2^23 rounds to integers, which then are the lowest bits.
    const MAGIC: f32 = 12_582_912.0;
    let shifted = x + MAGIC;
    let rest = x - (shifted - MAGIC);
    let mut power = 0.001_339_086_3;
    for coefficient in [
        0.009_676_032,
        0.055_503_57,
        0.240_221_07,
        std::f32::consts::LN_2,
        1.000_000_1,
    ] {
        power = power * rest + coefficient;
    }
    f32::from_bits(power.to_bits().wrapping_add(shifted.to_bits() << 23))
}

#[cfg(test)]
mod tests {
    use super::exp2;

    #[test]
    fn powers_of_two_are_right_to_the_last_bits() {
        for i in 0..=126_000 {
            let x = -(i as f32) / 1000.0;
            let exact = f64::from(x).exp2();
            let error = (f64::from(exp2(x)) / exact - 1.0).abs();
            assert!(error < 4e-7, "2^{x}: {error:e}");
        }
    }
}
