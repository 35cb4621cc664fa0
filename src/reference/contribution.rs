//! What a pixel would lose with each splat: the share of its colour that the splat makes up.

use super::expand::Isect;
use super::frame::{center, sorted};
use super::rasterize::layer;
use super::tiles::Grid;
use super::{ScreenSplat, Thresholds};
use std::collections::BTreeMap;

/// The weight `αᵢ Tᵢ` of each splat that a pixel blends, nearest first, as what passes before it less what passes
/// behind it: `(index into splats, weight)`.
pub fn weights(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    thresholds: &Thresholds,
) -> Vec<(usize, f64)> {
    let mut passing = 1.0;
    let mut weights = Vec::new();
    for &index in order {
        if passing < thresholds.transmittance_min {
            break;
        }
        if let Some(layer) = layer(&splats[index], position, thresholds) {
            let behind = passing * (1.0 - layer.alpha);
            weights.push((index, passing - behind));
            passing = behind;
        }
    }
    weights
}

/// What some pixels would lose with a splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// The largest of what is spent at a pixel and the splat's weight there, together; 0 where it counts nowhere.
    pub most: f64,
    /// The sum of its weights.
    pub sum: f64,
    /// The lowest limit of a pixel where it counts; infinite where it counts nowhere.
    pub limit: f64,
}

impl Loss {
    /// Of a splat that counts nowhere.
    pub const NOTHING: Loss = Loss {
        most: 0.0,
        sum: 0.0,
        limit: f64::INFINITY,
    };

    /// With one more pixel.
    pub fn and(self, weight: f64, spent: f64, limit: f64) -> Loss {
        Loss {
            most: self.most.max(spent + weight),
            sum: self.sum + weight,
            limit: self.limit.min(limit),
        }
    }
}

/// The losses of every (splat, tile) pair that some pixel blends, where `spent` and `limit` are given by pixel.
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
