//! What a splat does to pixels: the share it has in their errors, and by how much they would change without it.

use super::contribution::weights;
use super::expand::Isect;
use super::frame::{center, sorted};
use super::rasterize::rasterize;
use super::tiles::Grid;
use super::{ScreenSplat, Thresholds};
use std::collections::BTreeMap;

/// What a splat does to some pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RemovalError {
    /// The sum of its weights.
    pub weight: f64,
    /// The sum of its weights times the pixels' errors.
    pub error: f64,
    /// The sum, over pixels and channels, of the squares of what would change without it.
    pub change: f64,
    /// By how much `change` is off, relatively to δ, where every colour and every weight is off by δ, for small δ. What
    /// lies behind a splat is what is seen behind it divided by what it lets through: errors grow with that.
    pub slack: f64,
}

/// A pixel as one splat meets it.
#[derive(Clone, Copy, Debug)]
pub struct Touch {
    /// Index into the splats.
    pub splat: usize,
    /// Its weight `αᵢ Tᵢ`.
    pub weight: f64,
    /// By how much each channel would change without it: `w (B − c)`, B what is seen through it.
    pub change: [f64; 3],
    /// What its weight is of what passes behind it, where the pixel goes on.
    pub ratio: f64,
}

impl RemovalError {
    /// With one more pixel, of that error.
    pub fn and(self, touch: &Touch, error: f64) -> RemovalError {
        let square: f64 = touch.change.iter().map(|c| c * c).sum();
        let reach = 1.0 + touch.ratio;
        let slack: f64 = touch.change.iter().map(|c| 2.0 * c.abs() * reach).sum();
        RemovalError {
            weight: self.weight + touch.weight,
            error: self.error + touch.weight * error,
            change: self.change + square,
            // The square of an error of 1e-5 counts where nothing changes.
            slack: self.slack + slack + 3.0 * 1e-5 * reach * reach,
        }
    }
}

/// Every splat that a pixel blends, nearest first. Where the pixel has ended, the background is what lies behind.
pub fn touches(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    background: [f64; 3],
    thresholds: &Thresholds,
) -> Vec<Touch> {
    let blended = weights(splats, order, position, thresholds);
    // From the farthest on: nothing cancels.
    let mut passing = rasterize(splats, order, position, background, thresholds).transmittance;
    let mut seen = background.map(|c| c * passing);
    let touch = |&(splat, weight): &(usize, f64)| {
        let color = splats[splat].color;
        let behind = |k: usize| match passing > 0.0 {
            true => seen[k] / passing,
            false => background[k],
        };
        let touch = Touch {
            splat,
            weight,
            change: [0, 1, 2].map(|k| weight * (behind(k) - color[k])),
            ratio: match passing >= thresholds.transmittance_min {
                true => weight / passing,
                false => 0.0,
            },
        };
        passing += weight;
        (0..3).for_each(|k| seen[k] += weight * color[k]);
        touch
    };
    let mut touches: Vec<Touch> = blended.iter().rev().map(touch).collect();
    touches.reverse();
    touches
}

/// Of every (splat, tile) pair that some pixel blends, where errors are given by pixel.
pub fn removal_error(
    screen: &[Option<ScreenSplat<f64>>],
    grid: &Grid,
    background: [f64; 3],
    thresholds: &Thresholds,
    errors: &[f64],
) -> BTreeMap<Isect, RemovalError> {
    let (list, splat_from_rank) = sorted(screen);
    let order: Vec<usize> = (0..list.len()).collect();
    let mut found = BTreeMap::new();
    for (pixel, &error) in errors.iter().enumerate() {
        let position = center(pixel, grid.width as usize);
        let tile = grid.tile_from_position(position);
        for touch in touches(&list, &order, position, background, thresholds) {
            let splat = splat_from_rank[touch.splat] as u32;
            let sum = found.entry(Isect { tile, splat });
            let sum: &mut RemovalError = sum.or_default();
            *sum = sum.and(&touch, error);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_splat_changes_what_a_picture_without_it_lacks() {
        let splat = |opacity: f64, shade: f64| ScreenSplat {
            mean: [0.0; 2],
            covariance: [1.0, 0.0, 1.0],
            opacity,
            color: [shade, 1.0 - shade, 0.5],
            depth: 1.0,
        };
        let splats = [splat(0.5, 0.9), splat(0.3, 0.1), splat(0.7, 0.6)];
        let background = [0.2, 0.4, 0.8];
        let color = |order: &[usize]| {
            rasterize(&splats, order, [0.0; 2], background, &Thresholds::ENGINE).color
        };
        let whole = color(&[0, 1, 2]);
        let found = touches(
            &splats,
            &[0, 1, 2],
            [0.0; 2],
            background,
            &Thresholds::ENGINE,
        );
        assert_eq!(found.len(), 3);
        for (touch, rest) in found.iter().zip([[1, 2], [0, 2], [0, 1]]) {
            let without = color(&rest);
            for k in 0..3 {
                assert!((touch.change[k] - (without[k] - whole[k])).abs() < 1e-12);
            }
        }
    }
}
