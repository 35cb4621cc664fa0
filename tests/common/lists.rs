//! A frame's lists as the passes before compositing leave them, made by the oracle.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "shared by test binaries, each of which uses its own part"
)]

use crate::pack::{self, Splat2d};
use crate::scenes::Scene;
use ashfall::layout::View;
use ashfall::reference::expand::{Isect, expand};
use ashfall::reference::frame::project_all;
use ashfall::reference::ranges::ranges;
use ashfall::reference::tiles::Grid;
use ashfall::reference::{Cuts, ScreenSplat, Splat, Viewpoint};
use ashfall::render::{ViewOptions, view_of};

/// The camera as kernels read it.
pub fn view(scene: &Scene) -> View {
    let options = ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        mode: scene.splats.mode,
    };
    view_of(&scene.camera, &options)
}

/// The camera as the oracle reads it.
pub fn viewpoint(scene: &Scene) -> Viewpoint {
    Viewpoint::new(&scene.camera, &scene.options, scene.splats.mode)
}

/// See above.
pub struct Lists {
    /// Tiles of the image.
    pub grid: Grid,
    /// By splat; those that are not drawn hold NaNs.
    pub records: Vec<Splat2d>,
    /// What the device sees in the records.
    pub screen: Vec<Option<ScreenSplat<f64>>>,
    /// By source: nearest splat first, each one's tiles ascending.
    pub isects: Vec<Isect>,
    /// Sources by tile, nearest first in each.
    pub source_from_isect: Vec<u32>,
    /// Slices of the above.
    pub range_from_tile: Vec<[u32; 2]>,
}

impl Lists {
    /// Projects and lists a scene.
    pub fn new(scene: &Scene) -> Lists {
        let exact = project_all(&Splat::<f64>::all(&scene.splats), &viewpoint(scene));
        let faint = |s: &ScreenSplat<f64>| s.opacity < Cuts::ENGINE.alpha_min;
        let records: Vec<Option<Splat2d>> = exact
            .iter()
            .map(|s| s.as_ref().filter(|s| !faint(s)).map(pack::splat2d))
            .collect();
        let screen: Vec<_> = records
            .iter()
            .map(|record| record.as_ref().map(pack::screen_splat))
            .collect();
        let grid = Grid::new(scene.camera.width, scene.camera.height);
        let isects = expand(&screen, &grid, &Cuts::ENGINE);
        let mut source_from_isect: Vec<u32> = (0..isects.len() as u32).collect();
        source_from_isect.sort_by_key(|&source| isects[source as usize].tile);
        let sorted: Vec<u32> = source_from_isect
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
            source_from_isect,
        }
    }

    /// The splat of every source.
    pub fn splat_from_source(&self) -> Vec<u32> {
        self.isects.iter().map(|isect| isect.splat).collect()
    }
}
