//! Tiles that a splat touches: by testing their pixels, and by the minimum of `power` over the rectangle of their pixel
//! centres.
//!
//! A kernel must list every tile in which some pixel centre of the image has an alpha above the threshold
//! ([`holds_pixel`]); it may list tiles touched only between pixel centres ([`alpha_max`]); it should list few others.

use super::primitive::power_min;
use super::rasterize::raw_alpha;
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
pub fn holds_pixel(splat: &ScreenSplat<f64>, grid: &Grid, tile: u32, thresholds: &Thresholds) -> bool {
    alpha_at_pixels(splat, grid, tile) >= thresholds.alpha_min
}

/// Largest raw alpha over the rectangle that the tile's pixel centres span; never less than [`alpha_at_pixels`].
pub fn alpha_max(splat: &ScreenSplat<f64>, grid: &Grid, tile: u32) -> f64 {
    let [x, y] = grid
        .pixels(tile)
        .map(|(first, end)| [f64::from(first) + 0.5, f64::from(end) - 0.5]);
    splat.opacity * (-power_min(splat, x, y)).exp()
}

/// Tiles in which some pixel blends the splat if nothing lies in front of it, ascending.
pub fn tiles(splat: &ScreenSplat<f64>, grid: &Grid, thresholds: &Thresholds) -> Vec<u32> {
    (0..grid.len())
        .filter(|&tile| holds_pixel(splat, grid, tile, thresholds))
        .collect()
}
