//! A whole frame: every pixel over every splat, by depth, ties by index. No tiles.

use super::rasterize::{discontinuity_margin, rasterize};
use super::{DiscontinuityMargin, Options, Pixel, Real, ScreenSplat, Splat, Viewpoint, project};
use crate::scene::{Camera, Splats};
use rayon::prelude::*;

/// Rendered frame; rows from the top, `[y * width + x]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame<R> {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// The pixels.
    pub pixels: Vec<Pixel<R>>,
}

impl<R: Real> Frame<R> {
    /// The colours alone.
    pub fn colors(&self) -> Vec<[R; 3]> {
        self.pixels.iter().map(|p| p.color).collect()
    }
}

/// Centre of pixel `index` of an image, in pixels.
pub fn center(index: usize, width: usize) -> [f64; 2] {
    [(index % width) as f64 + 0.5, (index / width) as f64 + 0.5]
}

/// Projected splats, `None` if not drawn.
pub fn project_all<R: Real>(splats: &[Splat<R>], view: &Viewpoint) -> Vec<Option<ScreenSplat<R>>> {
    splats.par_iter().map(|splat| project(splat, view)).collect()
}

/// Indices of the drawn splats, nearest first, ties by index.
pub fn depth_order<R: Real>(screen: &[Option<ScreenSplat<R>>]) -> Vec<usize> {
    let depth = |i: usize| screen[i].map_or(f64::NAN, |s| s.depth.value());
    let mut order: Vec<usize> = (0..screen.len()).filter(|&i| screen[i].is_some()).collect();
    // A stable sort keeps ties by index.
    order.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)));
    order
}

/// Drawn splats, nearest first, and the scene's index of each.
pub fn sorted<R: Real>(screen: &[Option<ScreenSplat<R>>]) -> (Vec<ScreenSplat<R>>, Vec<usize>) {
    let splat_from_rank = depth_order(screen);
    let list = splat_from_rank.iter().filter_map(|&i| screen[i]).collect();
    (list, splat_from_rank)
}

/// Takes distances of the means from the camera's centre for depths, for an order by distance.
pub fn by_distance(screen: &mut [Option<ScreenSplat<f64>>], splats: &[Splat<f64>], view: &Viewpoint) {
    for (screen, splat) in screen.iter_mut().zip(splats) {
        if let Some(screen) = screen {
            screen.depth = glam::DVec3::from(splat.mean).distance(view.camera.position);
        }
    }
}

/// Renders projected splats.
pub fn render_screen<R: Real>(
    screen: &[Option<ScreenSplat<R>>],
    width: u32,
    height: u32,
    options: &Options,
) -> Frame<R> {
    let (list, _) = sorted(screen);
    let order: Vec<usize> = (0..list.len()).collect();
    let (width, height) = (width as usize, height as usize);
    let pixels = (0..width * height)
        .into_par_iter()
        .map(|i| rasterize(&list, &order, center(i, width), options.background, &options.thresholds))
        .collect();
    Frame { width, height, pixels }
}

/// Renders splats given by their parameters.
pub fn render_splats<R: Real>(splats: &[Splat<R>], view: &Viewpoint, options: &Options) -> Frame<R> {
    let screen = project_all(splats, view);
    render_screen(&screen, view.camera.width, view.camera.height, options)
}

/// Renders a scene.
pub fn render(splats: &Splats, camera: &Camera, options: &Options) -> Frame<f64> {
    let view = Viewpoint::on(splats, camera, options);
    render_splats(&Splat::all(splats), &view, options)
}

/// Distance of every pixel of [`render`] from the nearest discontinuity.
pub fn discontinuity_margins(splats: &Splats, camera: &Camera, options: &Options) -> Vec<DiscontinuityMargin> {
    let view = Viewpoint::on(splats, camera, options);
    margins(&Splat::all(splats), &view, options)
}

/// As [`discontinuity_margins`], of [`render_splats`].
pub fn margins(splats: &[Splat<f64>], view: &Viewpoint, options: &Options) -> Vec<DiscontinuityMargin> {
    let (list, _) = sorted(&project_all(splats, view));
    let order: Vec<usize> = (0..list.len()).collect();
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    (0..width * height)
        .into_par_iter()
        .map(|i| discontinuity_margin(&list, &order, center(i, width), &options.thresholds))
        .collect()
}
