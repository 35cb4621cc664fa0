//! Bound of every parameter's gradient, for a linear function of the picture.
//!
//! Let the objective be `Σ ⟨u, C⟩` over the pixels, with `u` fixed. At a pixel, splat `i` has
//! `sᵢ = αᵢ Tᵢ ⟨u, cᵢ − Bᵢ⟩`, its derivative by `ln αᵢ`, and `αᵢ Tᵢ u` by its colour. If a set `S` is left out and rays
//! stop at the transmittance `t`:
//!
//! * A splat that is left out loses all of `sᵢ`.
//! * The transmittance `T'ᵢ` before any other lies between `Tᵢ` and `Tᵢ / Π (1 − αₖ)` over `S` in front of it.
//! * Behind it, `Bᵢ` is a picture with the weights `αₖ Tₖ / Tᵢ₊₁`: `S` and the stop change `⟨u, Bᵢ⟩` there by at most
//!   `(Σ αₖ Tₖ + t) / Tᵢ₊₁` times `D`, the range of `⟨u, colour⟩`, and never by more than `D`.
//! * So `|s'ᵢ − sᵢ| ≤ αᵢ ((T'ᵢ − Tᵢ) |⟨u, cᵢ − Bᵢ⟩| + T'ᵢ |⟨u, B'ᵢ − Bᵢ⟩|)`.
//!
//! The factors from `sᵢ` to a parameter's gradient depend on the splat alone: `∂ ln αᵢ` by its screen row, and the
//! row's derivatives by its parameters. They are independent of approximations, and enter by their magnitudes.
//!
//! Rounding is bounded separately, to first order, see [`Job::add_rounding`]: that of a pixel's terms, and that of the
//! projection's derivatives, which is proportional to the terms of their sums and not to the remainder after
//! cancellation. The gradient by the rotation of a nearly round splat is such a remainder.
//!
//! The training loss is not linear and has no bound of this kind: the slope of its L1 part jumps where a pixel crosses
//! its photograph.

use super::stack::{Screen, Slice, Stack};
use super::{Approximations, MARGIN};
use crate::layout::ALPHA_MAX;
use crate::reference::gradient::SplatGradients;
use crate::reference::project::margins;
use crate::reference::project_backward::{slope_terms, slopes};
use crate::reference::{Options, ScreenSplat, Splat, Viewpoint};
use crate::scene::{Camera, Splats};
use rayon::prelude::*;

/// Rounding errors of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rounding {
    /// Relative error of alphas, and error of positions in standard deviations.
    pub share: f64,
    /// Relative error of one operation: 2⁻²⁴ in `f32`.
    pub unit: f64,
}

/// Bounds of the distance of gradients from the exact ones.
#[derive(Clone, Debug, PartialEq)]
pub struct GradientBounds {
    /// For each of the [`Approximations`], the maximum error of each parameter's gradient.
    pub bounds: Vec<SplatGradients>,
    /// Rounding error where it is largest: without approximations.
    pub rounding: SplatGradients,
    /// By splat: whether it is so near to a kink (a colour at 0, a Jacobian at its limit, the near plane) that rounding
    /// may take it across, to other gradients.
    pub kinked: Vec<bool>,
}

/// Bounds for the gradient of `Σ ⟨upstream, colour⟩`, `upstream` as `[y * width + x]`. `options.thresholds` are
/// ignored, and approximations must keep the scene (empty [`Approximations::color_error`], no
/// [`Approximations::stored`]).
pub fn gradient_bounds(
    splats: &Splats,
    camera: &Camera,
    options: &Options,
    upstream: &[[f64; 3]],
    approximations: &[Approximations],
    rounding: Rounding,
) -> GradientBounds {
    let is_scene = |s: &Approximations| s.color_error.is_empty() && s.stored.is_none();
    assert!(approximations.iter().all(is_scene), "approximations draw another scene");
    let screen = Screen::new(splats, camera, options);
    let job = Job {
        screen: &screen,
        width: camera.width as usize,
        background: options.background,
        approximations,
        rounding: rounding.share,
    };
    let sums = job.sums(upstream, splats.len());
    let view = Viewpoint::new(camera, options, splats.filter);
    let all = Splat::<f64>::all(splats);
    let slopes: Vec<Vec<[f64; 10]>> = all.par_iter().map(|splat| slopes(splat, &view)).collect();
    let by_screen = |which: usize, splat: usize| -> [f64; ROW] {
        let sum = |k: usize| sums.iter().map(|part| part[which][splat][k]).sum::<f64>();
        std::array::from_fn(sum)
    };
    let share_of_terms = SAFETY * rounding.unit;
    let entry = |slopes: &[f64; 10], by_screen: &[f64; ROW]| -> f64 {
        let terms = slopes.iter().zip(by_screen);
        terms.map(|(slope, sum)| slope.abs() * sum).sum()
    };
    let by_parameters = |which: usize| {
        let row = |(splat, slopes): (usize, &Vec<[f64; 10]>)| -> Vec<f64> {
            let by_screen = by_screen(which, splat);
            slopes.iter().map(|slopes| entry(slopes, &by_screen)).collect()
        };
        let rows: Vec<Vec<f64>> = slopes.iter().enumerate().map(row).collect();
        SplatGradients::from_rows(&rows)
    };
    let rounded = |(splat, (slopes, all)): (usize, (&Vec<[f64; 10]>, &Splat<f64>))| -> Vec<f64> {
        let off = by_screen(approximations.len(), splat);
        let terms = by_screen(approximations.len() + 1, splat);
        let slope_terms = slope_terms(all, &view);
        let both = slopes.iter().zip(&slope_terms);
        both.map(|(slopes, slope_terms)| entry(slopes, &off) + share_of_terms * entry(slope_terms, &terms))
            .collect()
    };
    let paired: Vec<_> = slopes.iter().zip(&all).enumerate().collect();
    let rounded: Vec<Vec<f64>> = paired.into_par_iter().map(rounded).collect();
    let near_kink = |splat: &Splat<f64>| {
        let margins = margins(splat, &view);
        margins.near.min(margins.limit).min(margins.color) < rounding.share
    };
    GradientBounds {
        bounds: (0..approximations.len()).map(by_parameters).collect(),
        rounding: SplatGradients::from_rows(&rounded),
        kinked: all.iter().map(near_kink).collect(),
    }
}

/// Factor for roundings of the device beyond the reference's formulas: its functions are accurate to a few units in the
/// last place, and its derivatives come from a backward pass over other intermediates of the same size.
const SAFETY: f64 = 4.0;

/// Differentiable numbers of a splat on the screen: [`ScreenSplat::row`] without its depth.
const ROW: usize = 9;

/// Sums of magnitudes by `[approximations, then rounding, then terms][splat]`.
type Sums = [Vec<[f64; ROW]>];

struct Job<'a> {
    screen: &'a Screen,
    width: usize,
    background: [f64; 3],
    approximations: &'a [Approximations],
    rounding: f64,
}

/// Objective at one pixel.
struct Linear {
    u: [f64; 3],
    /// Range of `⟨u, colour⟩`.
    range: f64,
    /// `|⟨u, cᵢ − Bᵢ⟩|` of every slice.
    steps: Vec<f64>,
    /// Σ α over the others of the slice's group, and transmittance before that group.
    places: Vec<(f64, f64)>,
    /// By slice: Σ `pairs` × transmittance over the groups behind it.
    exchanged: Vec<f64>,
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Linear {
    fn of(stack: &Stack, background: [f64; 3], u: &[f64; 3]) -> Linear {
        let slices = &stack.slices;
        let ranges = stack.ranges(background, 0.0);
        let mut steps = vec![0.0; slices.len()];
        let mut behind = dot(u, &background);
        for (slice, step) in slices.iter().zip(&mut steps).rev() {
            let apart = dot(u, &slice.color) - behind;
            *step = apart.abs();
            behind += slice.alpha * apart;
        }
        let mut places = vec![(0.0, 0.0); slices.len()];
        let mut exchanged = vec![0.0; slices.len()];
        let mut beyond = 0.0;
        for group in stack.groups().iter().rev() {
            for i in group.slices.clone() {
                places[i] = ((group.sum - slices[i].alpha).clamp(0.0, 1.0), group.before);
                exchanged[i] = beyond;
            }
            beyond += group.pairs * group.before;
        }
        Linear {
            u: *u,
            range: dot(&u.map(f64::abs), &ranges),
            steps,
            places,
            exchanged,
        }
    }

    /// Bound of the change of `⟨u, Bᵢ⟩` if this weight is exchanged behind the slice.
    fn behind(&self, slice: &Slice, weight: f64) -> f64 {
        let share = weight / (slice.before * (1.0 - slice.alpha));
        self.range * if share < 1.0 { share } else { 1.0 }
    }
}

fn leaves_out(approximations: &Approximations, slice: &Slice) -> bool {
    approximations.may_leave_out(slice.splat, slice.alpha)
}

/// Whether the cap of its alpha switches off a slice's gradient by shape; `None`: uncertain.
fn is_capped(slice: &Slice) -> Option<bool> {
    let cap = f64::from(ALPHA_MAX);
    let near = (slice.raw / cap - 1.0).abs() < MARGIN;
    (!near).then_some(slice.raw > cap)
}

impl Job<'_> {
    /// Sums over all pixels, in parts to be added.
    fn sums(&self, upstream: &[[f64; 3]], splats: usize) -> Vec<Vec<Vec<[f64; ROW]>>> {
        let height = self.screen.height;
        // One part per thread, not per row: each has its own sums.
        let part = height.div_ceil(rayon::current_num_threads());
        let parts: Vec<usize> = (0..height).step_by(part.max(1)).collect();
        let sums = parts.into_par_iter().map(|first| {
            let mut sums = vec![vec![[0.0; ROW]; splats]; self.approximations.len() + 2];
            for row in first..(first + part).min(height) {
                for (stack, u) in self.screen.row(row).zip(&upstream[row * self.width..]) {
                    self.add(&stack, u, &mut sums);
                }
            }
            sums
        });
        sums.collect()
    }

    fn add(&self, stack: &Stack, u: &[f64; 3], sums: &mut Sums) {
        let linear = Linear::of(stack, self.background, u);
        for (approximations, sums) in self.approximations.iter().zip(sums.iter_mut()) {
            self.add_saved(stack, &linear, approximations, sums);
        }
        if let [.., rounding, terms] = sums {
            self.add_rounding(stack, &linear, rounding, terms);
        }
    }

    /// Adds the bound of the approximations.
    fn add_saved(&self, stack: &Stack, linear: &Linear, approximations: &Approximations, sums: &mut [[f64; ROW]]) {
        let stop = approximations.transmittance_min * (1.0 + MARGIN);
        // Weight lost behind each slice, in weights of the exact frame.
        let mut lost = match stack.pixel.transmittance < stop {
            true => stop,
            false => 0.0,
        };
        let lost: Vec<f64> = stack
            .slices
            .iter()
            .rev()
            .map(|slice| {
                let behind = lost;
                if leaves_out(approximations, slice) {
                    lost += slice.alpha * slice.before;
                }
                behind
            })
            .collect();
        // Factor on the transmittance before the current slice.
        let mut opened = 1.0;
        for (i, (slice, lost)) in stack.slices.iter().zip(lost.iter().rev()).enumerate() {
            let passes = slice.before * opened;
            let (others, before_group) = linear.places[i];
            let exchanged = before_group * others * opened;
            let more = passes - slice.before + exchanged;
            let behind = linear.behind(slice, lost + linear.exchanged[i]);
            let mut shape = slice.alpha * (more * linear.steps[i] + passes * behind + exchanged * linear.range);
            let mut color = slice.alpha * more;
            if slice.before < stop || leaves_out(approximations, slice) {
                shape = shape.max(slice.alpha * slice.before * linear.steps[i]);
                color = color.max(slice.alpha * slice.before);
            }
            if leaves_out(approximations, slice) {
                opened /= 1.0 - slice.alpha;
            }
            shape = match is_capped(slice) {
                Some(false) => shape,
                Some(true) => 0.0,
                None => shape + slice.alpha * passes * (linear.steps[i] + behind),
            };
            let slopes = Slopes::of(&self.screen.list[slice.rank], stack.at);
            slopes.add(shape, &slopes.by_log_alpha, &mut sums[slice.splat]);
            add_color(color, &linear.u, &mut sums[slice.splat]);
        }
    }

    /// Adds the rounding errors. Transmittances are products of `1 − α` with relative errors of `α` times
    /// `α / (1 − α)`; a picture's colour errs by at most the relative error of its alphas times its range.
    ///
    /// `terms` are the magnitudes of the summands, which multiply the rounding of the projection's derivatives. The
    /// device takes second moments of whitened residuals `e = W d` and transforms them back by `Wᵀ`; the terms of that
    /// are `|W|ᵀ |e|`, at most [`Slopes::scale`] by Cauchy–Schwarz, as `Σ⁻¹ = WᵀW`.
    fn add_rounding(&self, stack: &Stack, linear: &Linear, sums: &mut [[f64; ROW]], terms: &mut [[f64; ROW]]) {
        let share = self.rounding;
        let mut amplified: f64 = 0.0;
        for (slice, step) in stack.slices.iter().zip(&linear.steps) {
            let weight = slice.alpha * slice.before;
            let off = (share * amplified).exp_m1() * slice.before;
            let before = if off < 1.0 { off } else { 1.0 };
            let color = slice.alpha * before + 2.0 * share * weight;
            let shape = color * step + 2.0 * share * weight * linear.range;
            amplified += slice.alpha / (1.0 - slice.alpha);
            let slopes = Slopes::of(&self.screen.list[slice.rank], stack.at);
            let (sums, terms) = (&mut sums[slice.splat], &mut terms[slice.splat]);
            if is_capped(slice) != Some(true) {
                // The slopes are rounded, too.
                slopes.add(shape + 3.0 * share * weight * step, &slopes.scale, sums);
                slopes.add(weight * step, &slopes.scale, terms);
            }
            add_color(color, &linear.u, sums);
            add_color(weight, &linear.u, terms);
        }
    }
}

/// Magnitudes of the derivatives of `ln α` at a position by mean, covariance and opacity.
struct Slopes {
    by_log_alpha: [f64; 6],
    /// Their magnitude when positions err by a share of a standard deviation.
    scale: [f64; 6],
}

impl Slopes {
    /// With `w = Σ⁻¹ d`, `ln α = ln opacity − ½ dᵀ Σ⁻¹ d` has the derivatives `w` and `½ w wᵀ`; the covariance's xy
    /// stands for both of its entries.
    fn of(splat: &ScreenSplat<f64>, at: [f64; 2]) -> Slopes {
        let [xx, xy, yy] = splat.covariance;
        let det = xx * yy - xy * xy;
        let [dx, dy] = [at[0] - splat.mean[0], at[1] - splat.mean[1]];
        let w = [(yy * dx - xy * dy) / det, (xx * dy - xy * dx) / det];
        // |w_x| ≤ √(Σ⁻¹)_xx · √(dᵀ Σ⁻¹ d), and likewise y: Cauchy–Schwarz.
        let far = 1.0 + (w[0] * dx + w[1] * dy).max(0.0).sqrt();
        let scale = [(yy / det).sqrt() * far, (xx / det).sqrt() * far];
        let all = |[x, y]: [f64; 2]| {
            let (x, y) = (x.abs(), y.abs());
            [x, y, 0.5 * x * x, x * y, 0.5 * y * y, 1.0 / splat.opacity]
        };
        Slopes {
            by_log_alpha: all(w),
            scale: all(scale),
        }
    }

    fn add(&self, weight: f64, slopes: &[f64; 6], sums: &mut [f64; ROW]) {
        for (sum, slope) in sums.iter_mut().zip(slopes) {
            *sum += weight * slope;
        }
    }
}

fn add_color(weight: f64, u: &[f64; 3], sums: &mut [f64; ROW]) {
    for (sum, u) in sums[6..].iter_mut().zip(u) {
        *sum += weight * u.abs();
    }
}
