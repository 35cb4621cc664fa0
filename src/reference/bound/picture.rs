//! Bound of a picture's colours.

use super::stack::{Screen, Stack};
use super::{Approximations, FAINT, MARGIN};
use crate::reference::frame::project_all;
use crate::reference::rasterize::layer;
use crate::reference::{Options, ScreenSplat, Splat, Thresholds, Viewpoint};
use crate::scene::{Camera, Splats};
use rayon::prelude::*;

/// A pixel of the exact frame, and bounds for approximated ones.
#[derive(Clone, Debug, PartialEq)]
pub struct TracedPixel {
    /// Colour.
    pub color: [f64; 3],
    /// For each of the [`Approximations`], the maximum difference of any channel.
    pub bounds: Vec<f64>,
    /// Range of values among the pixel's splats and its background; maximum over the channels.
    pub range: f64,
    /// Maximum change by exchange of splats at practically the same depth.
    pub order: f64,
}

/// Traces every pixel of a frame; `options.thresholds` are ignored.
pub fn trace(
    splats: &Splats,
    camera: &Camera,
    options: &Options,
    approximations: &[Approximations],
) -> Vec<TracedPixel> {
    let screen = Screen::new(splats, camera, options);
    let stored = |approximations: &Approximations| {
        let stored = approximations.stored.as_ref()?;
        let view = Viewpoint::new(camera, options, stored.filter);
        Some(project_all(&Splat::<f64>::all(stored), &view))
    };
    let stored: Vec<StoredScreen> = approximations.iter().map(stored).collect();
    let rows = (0..screen.height).into_par_iter();
    rows.flat_map_iter(|row| {
        let pixels = screen.row(row);
        let all = || approximations.iter().zip(&stored);
        let traced = pixels.map(|stack| traced(&stack, options.background, all()));
        traced.collect::<Vec<TracedPixel>>()
    })
    .collect()
}

/// Maximum error of any channel of each splat's colour; `drawn` gives the coefficient used instead of the one at an
/// index into `splats.sh`.
pub fn color_errors(splats: &Splats, drawn: impl Fn(usize) -> f64) -> Vec<f64> {
    let stride = splats.sh_stride();
    let of_splat = |splat: usize| {
        let mut sums = [0.0; 3];
        for l in 0..=splats.sh_degree as usize {
            for (channel, sum) in sums.iter_mut().enumerate() {
                let off = (l * l..(l + 1) * (l + 1)).map(|k| {
                    let index = splat * stride + k * 3 + channel;
                    f64::from(splats.sh[index]) - drawn(index)
                });
                let length = off.map(|d| d * d).sum::<f64>().sqrt();
                *sum += length * ((2 * l + 1) as f64 / (4.0 * std::f64::consts::PI)).sqrt();
            }
        }
        sums.into_iter().fold(0.0, f64::max)
    };
    (0..splats.len()).map(of_splat).collect()
}

/// Another scene's splats on the screen, in the order of the scene.
type StoredScreen = Option<Vec<Option<ScreenSplat<f64>>>>;

/// Losses of a pixel.
#[derive(Default)]
struct PixelLoss {
    /// Weight of the splats that are left out.
    weight: f64,
    /// Maximum transmittance at the stop.
    behind: f64,
    /// Weight moved by other alphas.
    moved: f64,
    /// Change by colour errors.
    color: f64,
    /// Maximum colour error.
    color_most: f64,
}

fn traced<'a>(
    stack: &Stack,
    background: [f64; 3],
    approximations: impl Iterator<Item = (&'a Approximations, &'a StoredScreen)>,
) -> TracedPixel {
    let range = stack.range(background, FAINT);
    let faint = stack.faint() * stack.range(background, 0.0);
    // Over splats of uncertain order: sums of α α and of α α T.
    let (mut pairs, mut order) = (0.0, 0.0);
    for group in stack.groups() {
        pairs += group.pairs;
        order += group.pairs * group.before;
    }
    let bound = |(approximations, stored): (&Approximations, &StoredScreen)| {
        let saved = saved(stack, approximations, stored);
        let range = range + 2.0 * saved.color_most;
        let weight = saved.weight + saved.moved;
        // A splat in front of an uncertain pair may be left out, and more light reach the pair.
        let order = pairs * weight * range;
        faint + saved.color + (weight + saved.behind) * range + order
    };
    TracedPixel {
        color: stack.pixel.over_background(background).color,
        bounds: approximations.map(bound).collect(),
        range,
        order: order * range,
    }
}

fn saved(stack: &Stack, approximations: &Approximations, stored: &StoredScreen) -> PixelLoss {
    let mut saved = PixelLoss::default();
    // Transmittance with the drawn alphas; `least` is not negative.
    let (mut before, mut least) = (1.0, 1.0_f64);
    for slice in &stack.slices {
        let off = approximations.color_error.get(slice.splat).copied().unwrap_or(0.0);
        saved.color += slice.alpha * slice.before * off;
        let alpha = match stored {
            None => slice.alpha,
            Some(screen) => drawn(screen[slice.splat].as_ref(), stack.at),
        };
        saved.moved += (alpha - slice.alpha).abs() * slice.before;
        if alpha >= FAINT {
            saved.color_most = saved.color_most.max(off);
            if approximations.may_leave_out(slice.splat, alpha) {
                saved.weight += alpha * before;
            }
        }
        before *= 1.0 - alpha;
        least *= (1.0 - alpha).max(0.0);
    }
    let stop = approximations.transmittance_min * (1.0 + MARGIN);
    if least < stop {
        saved.behind = stop;
    }
    saved
}

/// Alpha at a position.
fn drawn(splat: Option<&ScreenSplat<f64>>, at: [f64; 2]) -> f64 {
    let layer = splat.and_then(|splat| layer(splat, at, &Thresholds::NONE));
    layer.map_or(0.0, |layer| layer.alpha)
}
