//! Contribution of each splat to a pixel: its share of the pixel's colour.

use super::expand::Isect;
use super::frame::{center, sorted};
use super::rasterize::weights;
use super::tiles::Grid;
use super::{ScreenSplat, Thresholds};
use std::collections::BTreeMap;

/// Contribution of a splat over some pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Maximum over pixels of (weight + budget already spent); 0 if the splat has no weight anywhere.
    pub most: f64,
    /// Sum of the weights.
    pub sum: f64,
    /// Minimum limit of its pixels; infinite if the splat has no weight anywhere.
    pub limit: f64,
}

impl Loss {
    /// Contribution of a splat without weight.
    pub const NOTHING: Loss = Loss {
        most: 0.0,
        sum: 0.0,
        limit: f64::INFINITY,
    };

    /// Adds a pixel.
    pub fn and(self, weight: f64, spent: f64, limit: f64) -> Loss {
        Loss {
            most: self.most.max(spent + weight),
            sum: self.sum + weight,
            limit: self.limit.min(limit),
        }
    }
}

/// Contributions of every (splat, tile) pair that some pixel blends; `spent` and `limit` by pixel.
pub fn contribution(
    screen: &[Option<ScreenSplat<f64>>],
    grid: &Grid,
    thresholds: &Thresholds,
    spent: &[f64],
    limit: &[f64],
) -> BTreeMap<Isect, Loss> {
    let (list, splat_from_rank) = sorted(screen);
    let order: Vec<usize> = (0..list.len()).collect();
    let mut losses = BTreeMap::new();
    for pixel in 0..spent.len() {
        let position = center(pixel, grid.width as usize);
        let tile = grid.tile_from_position(position);
        for (rank, weight) in weights(&list, &order, position, thresholds) {
            let splat = splat_from_rank[rank] as u32;
            let loss = losses.entry(Isect { tile, splat }).or_insert(Loss::NOTHING);
            *loss = loss.and(weight, spent[pixel], limit[pixel]);
        }
    }
    losses
}
