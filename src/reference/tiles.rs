//! Tiles that a splat touches: by testing their pixels, and by minimising its quadratic form over the rectangle of
//! their pixel centres.
//!
//! A kernel must list every tile in which some pixel centre of the image has an alpha above the threshold
//! ([`holds_pixel`]); it may list tiles touched only between pixel centres ([`alpha_max`]); it should list few others.

use super::rasterize::{power, raw_alpha};
use super::{ScreenSplat, Thresholds};
use crate::layout::{TILE_HEIGHT, TILE_WIDTH};

/// Division of an image into tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Tile width, pixels.
    pub tile_width: u32,
    /// Tile height, pixels.
    pub tile_height: u32,
}

impl Grid {
    /// The engine's tiles over an image.
    pub fn new(width: u32, height: u32) -> Grid {
        Grid {
            width,
            height,
            tile_width: TILE_WIDTH,
            tile_height: TILE_HEIGHT,
        }
    }

    /// Tiles per row.
    pub fn columns(&self) -> u32 {
        self.width.div_ceil(self.tile_width)
    }

    /// Tiles per column.
    pub fn rows(&self) -> u32 {
        self.height.div_ceil(self.tile_height)
    }

    /// Number of tiles. Tile `index` lies in row `index / columns`.
    pub fn len(&self) -> u32 {
        self.columns() * self.rows()
    }

    /// Whether the image has no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Index of the tile at a position in the image (pixels).
    pub fn tile_from_position(&self, [x, y]: [f64; 2]) -> u32 {
        let column = (x / f64::from(self.tile_width)) as u32;
        let row = (y / f64::from(self.tile_height)) as u32;
        row * self.columns() + column
    }

    /// First pixel of a tile and the pixel after its last, clipped to the image: x and y.
    fn pixels(&self, tile: u32) -> [(u32, u32); 2] {
        let x = tile % self.columns() * self.tile_width;
        let y = tile / self.columns() * self.tile_height;
        let x_end = (x + self.tile_width).min(self.width);
        let y_end = (y + self.tile_height).min(self.height);
        [(x, x_end), (y, y_end)]
    }
}

/// Largest raw alpha of the splat at any pixel centre of the tile that lies in the image.
pub fn alpha_at_pixels(splat: &ScreenSplat<f64>, grid: &Grid, tile: u32) -> f64 {
    let [(x, x_end), (y, y_end)] = grid.pixels(tile);
    let centers = (y..y_end).flat_map(|y| (x..x_end).map(move |x| (x, y)));
    centers
        .map(|(x, y)| raw_alpha(splat, [f64::from(x) + 0.5, f64::from(y) + 0.5]))
        .fold(0.0, f64::max)
}

/// Whether some pixel of the tile blends the splat if nothing lies in front of it.
pub fn holds_pixel(
    splat: &ScreenSplat<f64>,
    grid: &Grid,
    tile: u32,
    thresholds: &Thresholds,
) -> bool {
    alpha_at_pixels(splat, grid, tile) >= thresholds.alpha_min
}

/// Largest raw alpha over the rectangle that the tile's pixel centres span; never less than [`alpha_at_pixels`].
pub fn alpha_max(splat: &ScreenSplat<f64>, grid: &Grid, tile: u32) -> f64 {
    let [x, y] = grid
        .pixels(tile)
        .map(|(first, end)| [f64::from(first) + 0.5, f64::from(end) - 0.5]);
    let [mean_x, mean_y] = splat.mean;
    if (x[0]..=x[1]).contains(&mean_x) && (y[0]..=y[1]).contains(&mean_y) {
        return splat.opacity;
    }
    // The form is convex: outside its minimum it is least on the border, and on a line it is a parabola with its
    // minimum at the conditional mean.
    let [xx, xy, yy] = splat.covariance;
    let mut least = f64::INFINITY;
    for edge in x {
        // x = edge: over y, the parabola is lowest at mean_y + xy / xx (x − mean_x).
        let y = (mean_y + xy / xx * (edge - mean_x)).clamp(y[0], y[1]);
        least = least.min(power(splat, [edge, y]));
    }
    for edge in y {
        let x = (mean_x + xy / yy * (edge - mean_y)).clamp(x[0], x[1]);
        least = least.min(power(splat, [x, edge]));
    }
    splat.opacity * (-least).exp()
}

/// Tiles in which some pixel blends the splat if nothing lies in front of it, ascending.
pub fn tiles(splat: &ScreenSplat<f64>, grid: &Grid, thresholds: &Thresholds) -> Vec<u32> {
    (0..grid.len())
        .filter(|&tile| holds_pixel(splat, grid, tile, thresholds))
        .collect()
}

/// Half width and half height, in pixels, of the box around the ellipse above the alpha threshold; 0 if the splat is
/// below it everywhere.
pub fn extent(splat: &ScreenSplat<f64>, thresholds: &Thresholds) -> [f64; 2] {
    // opacity · exp(−r² / 2) = alpha_min at the squared Mahalanobis radius r², and an ellipse extends along an axis by
    // r times its standard deviation.
    let squared_radius = 2.0 * (splat.opacity / thresholds.alpha_min).ln();
    let [xx, _, yy] = splat.covariance;
    [xx, yy].map(|variance| (squared_radius.max(0.0) * variance).sqrt())
}
