//! Inputs of compositing: a frame's lists from the oracle.

use super::pack::{self, Splat2d};
use super::scene::Scene;
use crate::layout::View;
use crate::reference::expand::Isect;
use crate::reference::frame::{depth_order, project_all};
use crate::reference::linear::{dot, normalize};
use crate::reference::primitive::extent;
use crate::reference::ranges::ranges;
use crate::reference::surfel::SurfelDisc;
use crate::reference::tiles::{Grid, holds_pixel};
use crate::reference::{ScreenSplat, Splat, Thresholds, Viewpoint};
use crate::render::{ViewOptions, view_of};
use rayon::prelude::*;

/// The camera in the kernels' form.
pub fn view(scene: &Scene) -> View {
    let options = ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        filter: scene.splats.filter,
    };
    view_of(&scene.camera, &options)
}

/// The camera in the oracle's form.
pub fn viewpoint(scene: &Scene) -> Viewpoint {
    Viewpoint::on(&scene.splats, &scene.camera, &scene.options)
}

/// Projected splats and their intersections.
#[derive(Clone, Debug)]
pub struct Lists {
    /// Tiles of the image.
    pub grid: Grid,
    /// By splat; NaN for splats that are not drawn.
    pub records: Vec<Splat2d>,
    /// Splats as the device decodes them from the records.
    pub screen: Vec<Option<ScreenSplat<f64>>>,
    /// By source: nearest splat first, each with its tiles ascending.
    pub isects: Vec<Isect>,
    /// Sources by tile, nearest first.
    pub emitted_from_isect: Vec<u32>,
    /// Slices of `emitted_from_isect`.
    pub range_from_tile: Vec<[u32; 2]>,
}

/// Whether a surfel is seen at less than 17 degrees: rounding counts over the cosine there, and is judged by whole
/// frames (`tests/device/surfels.rs`).
fn is_grazed(splat: &ScreenSplat<f64>) -> bool {
    let cosine = |disc: SurfelDisc<f64>| dot(disc.normal, normalize(disc.mean)).abs();
    splat.disc.is_some_and(|disc| cosine(disc) < 0.3)
}

impl Lists {
    /// Projects a scene and lists it by the engine's tiles.
    pub fn new(scene: &Scene) -> Lists {
        Lists::over(scene, Grid::new(scene.camera.width, scene.camera.height))
    }

    /// Projects a scene and lists it by the tiles of `grid`.
    pub fn over(scene: &Scene, grid: Grid) -> Lists {
        let exact = project_all(&Splat::<f64>::all(&scene.splats), &viewpoint(scene));
        let faint = |s: &ScreenSplat<f64>| s.opacity < Thresholds::ENGINE.alpha_min || is_grazed(s);
        let records: Vec<Option<Splat2d>> = exact
            .iter()
            .map(|s| s.as_ref().filter(|s| !faint(s)).map(pack::splat2d))
            .collect();
        let decoded = |(record, exact): (&Option<Splat2d>, &Option<ScreenSplat<f64>>)| {
            let disc = exact.as_ref()?.disc;
            record.as_ref().map(|record| ScreenSplat {
                disc,
                ..pack::screen_splat(record)
            })
        };
        let screen: Vec<_> = records.iter().zip(&exact).map(decoded).collect();
        let isects = isects(&screen, &grid);
        let mut emitted_from_isect: Vec<u32> = (0..isects.len() as u32).collect();
        emitted_from_isect.sort_by_key(|&source| isects[source as usize].tile);
        let sorted: Vec<u32> = emitted_from_isect
            .iter()
            .map(|&source| isects[source as usize].tile)
            .collect();
        let nothing = Splat2d {
            shape: [f32::NAN; 4],
            tone: [f32::NAN; 4],
            rest: [f32::NAN; 2],
        };
        Lists {
            range_from_tile: ranges(&sorted, grid.len()),
            grid,
            records: records.iter().map(|r| r.unwrap_or(nothing)).collect(),
            screen,
            isects,
            emitted_from_isect,
        }
    }

    /// Splat of every source.
    pub fn splat_from_emitted(&self) -> Vec<u32> {
        self.isects.iter().map(|isect| isect.splat).collect()
    }

    /// Splat of every intersection, tile by tile.
    pub fn splat_from_isect(&self) -> Vec<u32> {
        let splat = |&source: &u32| self.isects[source as usize].splat;
        self.emitted_from_isect.iter().map(splat).collect()
    }
}

/// Result of `reference::expand`, computed faster: only tiles in the box around a splat's ellipse are tested.
fn isects(screen: &[Option<ScreenSplat<f64>>], grid: &Grid) -> Vec<Isect> {
    let listed = |&index: &usize| -> Vec<Isect> {
        let near = screen[index].iter().flat_map(|splat| {
            let held = |&tile: &u32| holds_pixel(splat, grid, tile, &Thresholds::ENGINE);
            tiles_near(splat, grid).filter(held)
        });
        let splat = index as u32;
        near.map(|tile| Isect { tile, splat }).collect()
    };
    let listed: Vec<Vec<Isect>> = depth_order(screen).par_iter().map(listed).collect();
    listed.concat()
}

/// Tiles that the box around a splat's ellipse meets, ascending, with a margin for rounding.
pub fn tiles_near(splat: &ScreenSplat<f64>, grid: &Grid) -> impl Iterator<Item = u32> + use<> {
    let [half_x, half_y] = extent(splat, &Thresholds::ENGINE);
    // Casts saturate at 0.
    let tiles = |mean: f64, half: f64, size: u32, count: u32| {
        let first = ((mean - half - 1.0) / f64::from(size)).floor() as u32;
        let end = ((mean + half + 1.0) / f64::from(size)).floor() + 1.0;
        first..(end as u32).min(count)
    };
    let columns = tiles(splat.mean[0], half_x, grid.tile_width, grid.columns());
    let rows = tiles(splat.mean[1], half_y, grid.tile_height, grid.rows());
    let in_row = grid.columns();
    rows.flat_map(move |row| columns.clone().map(move |column| row * in_row + column))
}

#[cfg(test)]
mod tests {
    use super::super::scene::scattered;
    use super::*;
    use crate::reference::expand::expand;

    #[test]
    fn looking_at_fewer_tiles_finds_the_same() {
        let scene = scattered(300, [97, 61], 9.0, 0);
        for tile in [[8, 16], [16, 16]] {
            let grid = Grid {
                width: 97,
                height: 61,
                tile_width: tile[0],
                tile_height: tile[1],
            };
            let lists = Lists::over(&scene, grid);
            assert_eq!(lists.isects, expand(&lists.screen, &grid, &Thresholds::ENGINE));
            assert_eq!(lists.splat_from_isect().len(), lists.isects.len());
        }
    }
}
