//! All pairs of a splat and a tile that it touches.

use super::frame::depth_order;
use super::tiles::{Grid, tiles};
use super::{ScreenSplat, Thresholds};

/// A splat in a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Isect {
    /// The tile.
    pub tile: u32,
    /// Index of the splat in the scene.
    pub splat: u32,
}

/// All intersections: splats nearest first, tiles of a splat ascending.
pub fn expand(screen: &[Option<ScreenSplat<f64>>], grid: &Grid, thresholds: &Thresholds) -> Vec<Isect> {
    let mut list = Vec::new();
    for index in depth_order(screen) {
        let touched = screen[index].iter().flat_map(|splat| tiles(splat, grid, thresholds));
        list.extend(touched.map(|tile| Isect {
            tile,
            splat: index as u32,
        }));
    }
    list
}
