//! The bound of a picture's colours.

use super::stack::{Screen, Stack};
use super::{FAINT, MARGIN, Savings};
use crate::reference::Options;
use crate::scene::{Camera, Splats};
use rayon::prelude::*;

/// A pixel of the frame that saves nothing, and how far others may be from it.
#[derive(Clone, Debug, PartialEq)]
pub struct Traced {
    /// Its colour.
    pub color: [f64; 3],
    /// For each of the [`Savings`], the most by which any channel may differ.
    pub bounds: Vec<f64>,
    /// Difference between the largest and the smallest value that a channel has among the pixel's splats
    /// and its background; the largest over the channels.
    pub range: f64,
    /// What exchanging splats of practically the same depth may change.
    pub order: f64,
}

/// Traces every pixel of a frame; `options.cuts` are not made.
pub fn trace(
    splats: &Splats,
    camera: &Camera,
    options: &Options,
    savings: &[Savings],
) -> Vec<Traced> {
    let screen = Screen::new(splats, camera, options);
    let rows = (0..screen.height).into_par_iter();
    rows.flat_map_iter(|row| {
        let pixels = screen.row(row);
        let traced = pixels.map(|stack| traced(&stack, options.background, savings));
        traced.collect::<Vec<Traced>>()
    })
    .collect()
}

/// By how much any channel of each splat's colour may be off, where `stored` gives what is drawn with in
/// place of the coefficient of an index and a value.
pub fn color_errors(splats: &Splats, stored: impl Fn(usize, f32) -> f64) -> Vec<f64> {
    let row = |row: &[f32]| {
        let mut sums = [0.0; 3];
        for l in 0..=splats.sh_degree as usize {
            for (channel, sum) in sums.iter_mut().enumerate() {
                let off = (l * l..(l + 1) * (l + 1)).map(|k| {
                    let value = row[k * 3 + channel];
                    f64::from(value) - stored(k, value)
                });
                let length = off.map(|d| d * d).sum::<f64>().sqrt();
                *sum += length * ((2 * l + 1) as f64 / (4.0 * std::f64::consts::PI)).sqrt();
            }
        }
        sums.into_iter().fold(0.0, f64::max)
    };
    splats
        .sh
        .chunks_exact(splats.sh_stride())
        .map(row)
        .collect()
}

/// What a pixel may lose.
#[derive(Default)]
struct Saved {
    /// Weight of the splats that are left out.
    weight: f64,
    /// Most that passes where it stops.
    behind: f64,
    /// What colours that are off come to.
    color: f64,
    /// The most that one is off by.
    color_most: f64,
}

fn traced(stack: &Stack, background: [f64; 3], savings: &[Savings]) -> Traced {
    let range = stack.range(background, FAINT);
    let faint = stack.faint() * stack.range(background, 0.0);
    // Over splats that may change places: sums of α α and of α α T.
    let (mut pairs, mut order) = (0.0, 0.0);
    for group in stack.groups() {
        pairs += group.pairs;
        order += group.pairs * group.before;
    }
    let bound = |savings: &Savings| {
        let saved = saved(stack, savings);
        let range = range + 2.0 * saved.color_most;
        // A splat before two that change places may be left out, and more light reach them.
        let order = pairs * saved.weight * range;
        faint + saved.color + (saved.weight + saved.behind) * range + order
    };
    Traced {
        color: stack.pixel.over_background(background).color,
        bounds: savings.iter().map(bound).collect(),
        range,
        order: order * range,
    }
}

fn saved(stack: &Stack, savings: &Savings) -> Saved {
    let mut saved = Saved::default();
    for slice in &stack.slices {
        let weight = slice.alpha * slice.before;
        let off = savings.color_error.get(slice.splat).copied().unwrap_or(0.0);
        saved.color += weight * off;
        if slice.alpha < FAINT {
            continue;
        }
        saved.color_most = saved.color_most.max(off);
        if savings.may_leave_out(slice) {
            saved.weight += weight;
        }
    }
    let stop = savings.transmittance_min * (1.0 + MARGIN);
    if stack.pixel.transmittance < stop {
        saved.behind = stop;
    }
    saved
}
