//! How far a frame that saves work may lie from the one that does not: a bound for every pixel.
//!
//! With `C = Σ cᵢ αᵢ Tᵢ + T_end · background` and `Bᵢ` what is seen through splat `i`, a splat that is left
//! out changes the pixel by `αᵢ Tᵢ (Bᵢ − cᵢ)`. Taken out from the back, each splat of a set leaves the
//! transmittance before the others alone, so that a set `S` costs at most `Σ_S αᵢ Tᵢ` times the range of the
//! pixel's colours, with the weights of the whole frame. The other savings follow from it:
//!
//! * An alpha cut, a limit on standard deviations and removed splats leave out what they say.
//! * A stop at the transmittance `t`, the last splat included, replaces what is behind by the background,
//!   where less than `t` passes: `t` times the range, and nothing where more passes through everything.
//! * Colours that are off by `δᵢ` cost `Σ αᵢ Tᵢ δᵢ`. Of harmonics of degree `l` that are off by the
//!   vector `d_l`, `δ ≤ Σ_l ‖d_l‖ √((2l+1) / 4π)` in every direction (Cauchy–Schwarz, and the addition
//!   theorem, by which `Σ_m Y_lm² = (2l+1) / 4π`).

use super::frame::{center, project_all, sorted};
use super::rasterize::{layer, power};
use super::{Cuts, Options, Pixel, ScreenSplat, Splat, Viewpoint};
use crate::scene::{Camera, Splats};
use rayon::prelude::*;

/// What a frame saves.
#[derive(Clone, Debug, PartialEq)]
pub struct Savings {
    /// Alphas below this are left out.
    pub alpha_min: f64,
    /// A pixel is finished once less than this passes.
    pub transmittance_min: f64,
    /// What is farther than so many standard deviations from its centre may be left out.
    pub sigma_max: f64,
    /// By how much any channel of a splat's colour may be off, by splat; empty: nothing.
    pub color_error: Vec<f64>,
    /// Which splats are not drawn; empty: none.
    pub removed: Vec<bool>,
}

impl Savings {
    /// None at all.
    pub const NONE: Savings = Savings {
        alpha_min: 0.0,
        transmittance_min: 0.0,
        sigma_max: f64::INFINITY,
        color_error: Vec::new(),
        removed: Vec::new(),
    };
}

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

/// How far, relatively, a threshold may be moved by rounding: what lies that near to one counts as left out.
const MARGIN: f64 = 1e-3;

/// Depths that differ by less than this, relatively, may come in either order: a depth in `f32` is a sum of
/// three rounded products, and a few units in the last place of the largest are ten of the result's.
const SAME_DEPTH: f64 = 2e-6;

/// Alphas below this do not widen a pixel's range of colours; all of them are left out instead, at the range
/// that they have.
const FAINT: f64 = 1e-9;

/// Squared standard deviations beyond which `raw_alpha` is 0: the power is over 50.
const REACH: f64 = 100.0;

/// Traces every pixel of a frame; `options.cuts` are not made.
pub fn trace(
    splats: &Splats,
    camera: &Camera,
    options: &Options,
    savings: &[Savings],
) -> Vec<Traced> {
    let view = Viewpoint::new(camera, options, splats.mode);
    let (list, splat_from_rank) = sorted(&project_all(&Splat::<f64>::all(splats), &view));
    let width = camera.width as usize;
    let rows = (0..camera.height as usize).into_par_iter();
    rows.flat_map_iter(|row| {
        let y = row as f64 + 0.5;
        // `power` is at least half the squared distance along one axis: what is too far in y is 0.
        let reaches = |s: &ScreenSplat<f64>| (y - s.mean[1]).powi(2) <= REACH * s.covariance[2];
        let near: Vec<usize> = (0..list.len()).filter(|&i| reaches(&list[i])).collect();
        let pixels: Vec<Traced> = (0..width)
            .map(|x| {
                let at = center(row * width + x, width);
                let stack = Stack::new(&list, &near, &splat_from_rank, at);
                stack.traced(options.background, savings)
            })
            .collect();
        pixels
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

/// A splat at a pixel.
struct Slice {
    /// Its index in the scene.
    splat: usize,
    alpha: f64,
    color: [f64; 3],
    depth: f64,
    /// Squared standard deviations from its centre.
    level: f64,
    /// Transmittance before it.
    before: f64,
}

/// All that a pixel sees, nearest first.
struct Stack {
    slices: Vec<Slice>,
    pixel: Pixel<f64>,
}

impl Stack {
    fn new(
        list: &[ScreenSplat<f64>],
        near: &[usize],
        splat_from_rank: &[usize],
        position: [f64; 2],
    ) -> Stack {
        let mut stack = Stack {
            slices: Vec::new(),
            pixel: Pixel::clear(),
        };
        for &rank in near {
            let Some(layer) = layer(&list[rank], position, &Cuts::NONE) else {
                continue;
            };
            stack.slices.push(Slice {
                splat: splat_from_rank[rank],
                alpha: layer.alpha,
                color: layer.color,
                depth: layer.depth,
                level: 2.0 * power(&list[rank], position),
                before: stack.pixel.transmittance,
            });
            stack.pixel = stack.pixel.over(&layer);
        }
        stack
    }

    /// The largest range of a channel among splats of at least an alpha, and the background.
    fn range(&self, background: [f64; 3], alpha_min: f64) -> f64 {
        let (mut low, mut high) = (background, background);
        for slice in self.slices.iter().filter(|s| s.alpha >= alpha_min) {
            for channel in 0..3 {
                low[channel] = low[channel].min(slice.color[channel]);
                high[channel] = high[channel].max(slice.color[channel]);
            }
        }
        (0..3).map(|c| high[c] - low[c]).fold(0.0, f64::max)
    }

    fn traced(&self, background: [f64; 3], savings: &[Savings]) -> Traced {
        let range = self.range(background, FAINT);
        let faint = self.slices.iter().filter(|s| s.alpha < FAINT);
        let faint = faint.map(|s| s.alpha * s.before).sum::<f64>() * self.range(background, 0.0);
        let (pairs, order) = self.exchanges();
        let bound = |savings: &Savings| {
            let saved = self.saved(savings);
            let range = range + 2.0 * saved.color_most;
            // A splat before two that change places may be left out, and more light reach them.
            let order = pairs * saved.weight * range;
            faint + saved.color + (saved.weight + saved.behind) * range + order
        };
        Traced {
            color: self.pixel.over_background(background).color,
            bounds: savings.iter().map(bound).collect(),
            range,
            order: order * range,
        }
    }

    /// Over splats that may change places: sums of α α and of α α T.
    fn exchanges(&self) -> (f64, f64) {
        let (mut pairs, mut weights) = (0.0, 0.0);
        let mut first = 0;
        for end in 1..=self.slices.len() {
            let apart = |s: &[Slice]| s[end].depth - s[end - 1].depth > SAME_DEPTH * s[end].depth;
            if end < self.slices.len() && !apart(&self.slices) {
                continue;
            }
            let group = &self.slices[first..end];
            let sum: f64 = group.iter().map(|s| s.alpha).sum();
            let squares: f64 = group.iter().map(|s| s.alpha * s.alpha).sum();
            // Σ_{i<j} αᵢ αⱼ; rounding must not make it negative.
            let products = 0.5 * (sum * sum - squares).max(0.0);
            pairs += products;
            weights += products * group[0].before;
            first = end;
        }
        (pairs, weights)
    }

    fn saved(&self, savings: &Savings) -> Saved {
        let mut saved = Saved::default();
        let removed = |splat: usize| savings.removed.get(splat).copied().unwrap_or(false);
        let level_max = savings.sigma_max * savings.sigma_max * (1.0 - MARGIN);
        for slice in &self.slices {
            let weight = slice.alpha * slice.before;
            let off = savings.color_error.get(slice.splat).copied().unwrap_or(0.0);
            saved.color += weight * off;
            let is_faint = slice.alpha < FAINT;
            if !is_faint {
                saved.color_most = saved.color_most.max(off);
            }
            let is_cut = slice.alpha < savings.alpha_min * (1.0 + MARGIN)
                || slice.level > level_max
                || removed(slice.splat);
            if is_cut && !is_faint {
                saved.weight += weight;
            }
        }
        let stop = savings.transmittance_min * (1.0 + MARGIN);
        if self.pixel.transmittance < stop {
            saved.behind = stop;
        }
        saved
    }
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
