//! A frame by the rules of the 3DGS code (Kerbl et al. 2023, its `forward.cu` and `auxiliary.h`), with more
//! approximations than the engine: every pixel over every splat, no lists.

use super::frame::{Frame, center, project_all, sorted};
use super::rasterize::{Pixel, layer};
use super::{Options, ScreenSplat, Splat, Thresholds, Viewpoint};
use crate::scene::{Camera, Splats};
use rayon::prelude::*;

/// Side of its tiles, pixels.
const TILE: f64 = 16.0;

/// Its thresholds: alphas under 1/255 are skipped, alphas are capped at 0.99, and the splat that would take the
/// transmittance below 1e-4 is not blended.
pub const CUTS: Thresholds = Thresholds {
    alpha_min: 1.0 / 255.0,
    alpha_max: 0.99,
    transmittance_min: 1e-4,
};

/// Tiles that list a splat, along x and along y: the first, and the one after the last. A square of three times the
/// largest standard deviation, rounded up to whole pixels; pixel centres are at whole numbers.
pub fn square(splat: &ScreenSplat<f64>) -> [(f64, f64); 2] {
    let radius = reach(splat).ceil();
    splat.mean.map(|mean| {
        let first = ((mean - 0.5 - radius) / TILE).trunc();
        let end = ((mean - 0.5 + radius + TILE - 1.0) / TILE).trunc();
        (first.max(0.0), end.max(0.0))
    })
}

/// Three times the largest standard deviation, pixels.
fn reach(splat: &ScreenSplat<f64>) -> f64 {
    let [xx, xy, yy] = splat.covariance;
    let middle = 0.5 * (xx + yy);
    let apart = (middle * middle - (xx * yy - xy * xy)).max(0.1).sqrt();
    3.0 * (middle + apart).sqrt()
}

/// Distance of a splat from being listed for other tiles, pixels: of its position, or of three standard deviations.
pub fn margin(splat: &ScreenSplat<f64>) -> f64 {
    let reach = reach(splat);
    let from_whole = |x: f64| (x - x.round()).abs();
    let edges = splat.mean.map(|mean| {
        let low = from_whole((mean - 0.5 - reach.ceil()) / TILE);
        let high = from_whole((mean - 0.5 + reach.ceil() + TILE - 1.0) / TILE);
        TILE * low.min(high)
    });
    edges[0].min(edges[1]).min(from_whole(reach))
}

/// Whether the tile of a pixel position lists the splat.
fn lists(splat: &ScreenSplat<f64>, position: [f64; 2]) -> bool {
    let inside = |x: f64, (first, end): (f64, f64)| (first..end).contains(&(x / TILE).floor());
    let [columns, rows] = square(splat);
    inside(position[0], columns) && inside(position[1], rows)
}

/// One pixel over the sorted splats that its tile lists, nearest first, and the distance to the nearest threshold; see
/// [`over`].
pub fn pixel(splats: &[ScreenSplat<f64>], position: [f64; 2], background: [f64; 3]) -> (Pixel<f64>, f64) {
    let listed = splats.iter().filter(|splat| lists(splat, position));
    let (pixel, _, nearest) = over(listed, position, background);
    (pixel, nearest)
}

/// One pixel over splats, nearest first; the number of blended splats; and the smallest relative distance of an alpha
/// or a transmittance to its threshold.
pub fn over<'a>(
    splats: impl Iterator<Item = &'a ScreenSplat<f64>>,
    position: [f64; 2],
    background: [f64; 3],
) -> (Pixel<f64>, usize, f64) {
    let mut blended = 0;
    let mut pixel = Pixel::<f64>::clear();
    let mut nearest = f64::INFINITY;
    for splat in splats {
        let raw = super::rasterize::raw_alpha(splat, position);
        nearest = nearest.min((raw / CUTS.alpha_min - 1.0).abs());
        let Some(layer) = layer(splat, position, &CUTS) else {
            continue;
        };
        let next = pixel.transmittance * (1.0 - layer.alpha);
        nearest = nearest.min((next / CUTS.transmittance_min - 1.0).abs());
        if next < CUTS.transmittance_min {
            break;
        }
        pixel = pixel.over(&layer);
        blended += 1;
    }
    (pixel.over_background(background), blended, nearest)
}

/// Renders a scene; also returns each pixel's distance to its nearest threshold.
pub fn render(splats: &Splats, camera: &Camera, options: &Options) -> (Frame<f64>, Vec<f64>) {
    let view = Viewpoint::new(camera, options, splats.filter);
    let (list, _) = sorted(&project_all(&Splat::<f64>::all(splats), &view));
    let (width, height) = (camera.width as usize, camera.height as usize);
    let (pixels, nearest): (Vec<_>, Vec<f64>) = (0..width * height)
        .into_par_iter()
        .map(|i| pixel(&list, center(i, width), options.background))
        .unzip();
    let frame = Frame { width, height, pixels };
    (frame, nearest)
}
