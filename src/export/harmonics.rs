//! Harmonics of a splat, rounded together.
//!
//! With Y the basis in the direction of a view and w the splat's weight there, rounding errors Δ of a channel change the
//! picture by Δᵀ G Δ, G = Σ w Y Yᵀ / Σ w + μ/4π: the second part is the mean over all directions, for views that are not
//! among those. With G = Rᵀ R, R upper triangular, the coefficients are rounded from the last to the first, each to the
//! grid point nearest to the value that makes up for the errors so far (Babai's nearest plane). The constant one has
//! the finest grid and is last; it is shifted here and rounded by the format.

use super::influence::Influence;
use crate::scene::{Splats, sh_coefficient_count};
use crate::simplify::factorize;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Values that a format has for harmonics above degree 0.
#[derive(Clone, Copy, Debug)]
pub enum Grid<'a> {
    /// Multiples of a step plus an offset.
    Steps {
        /// Step of degrees 1, 2 and 3; 0 for a degree that is left out.
        step: [f64; 3],
        /// Value nearest to zero from above.
        offset: f64,
        /// Largest magnitude.
        limit: f64,
    },
    /// Given values in the layout of [`Splats::sh`]: only the constant coefficient follows.
    Given(&'a [f32]),
}

/// Constants of joint rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rounding {
    /// Share of all directions alike in the error of a splat, μ.
    pub all_round: f64,
    /// Largest shift of a coefficient for the sake of others, steps.
    pub reach: f64,
    /// Price of a bit, as squared error of the colour of a splat of mean weight: dead zone of the coefficients.
    pub bit_price: f64,
}

impl Default for Rounding {
    fn default() -> Rounding {
        Rounding {
            all_round: 0.1,
            reach: 1.0,
            bit_price: 0.0,
        }
    }
}

/// Least weight of a splat in the price of its bits, relative to the mean: it may be seen from elsewhere.
const LEAST_WEIGHT: f64 = 0.05;

/// Splats with harmonics above degree 0 on a grid, and constant ones that make up for the errors in the views.
///
/// # Panics
/// If `influence` has another number of splats.
pub fn round_harmonics(splats: &Splats, influence: &Influence, grid: Grid<'_>, rounding: Rounding) -> Splats {
    let stride = splats.sh_stride();
    let mut rounded = splats.clone();
    rounded.sh.par_chunks_exact_mut(stride).enumerate().for_each(|(i, sh)| {
        let weight = influence.of(i).max(LEAST_WEIGHT);
        let metric = metric(influence, i, splats.mean[i], splats.sh_degree, rounding.all_round);
        let given = match grid {
            Grid::Given(values) => Some(&values[i * stride..][..stride]),
            Grid::Steps { .. } => None,
        };
        for channel in 0..3 {
            round_channel(sh, channel, &metric, |k, value, pull, curvature| match (grid, given) {
                (_, Some(given)) => f64::from(given[3 * k + channel]),
                (Grid::Steps { step, offset, limit }, _) => {
                    let step = step[k.isqrt() - 1];
                    let cost = rounding.bit_price / (weight * curvature);
                    on_grid(value, pull, GridLine { step, offset, limit }, rounding.reach, cost)
                }
                (Grid::Given(_), None) => value,
            });
        }
    });
    rounded
}

/// Lower triangle L of the metric, with L Lᵀ = G.
fn metric(influence: &Influence, splat: usize, mean: [f32; 3], degree: u32, all_round: f64) -> Vec<f64> {
    let size = sh_coefficient_count(degree);
    let mut matrix = vec![0.0; size * size];
    let mut total = 0.0;
    for (weight, basis) in influence.views(splat, mean) {
        total += weight;
        for i in 0..size {
            for j in 0..=i {
                matrix[i * size + j] += weight * basis[i] * basis[j];
            }
        }
    }
    if total > 0.0 {
        matrix.iter_mut().for_each(|v| *v /= total);
    }
    let around = if total > 0.0 { all_round } else { 1.0 } / (4.0 * PI);
    (0..size).for_each(|i| matrix[i * size + i] += around);
    factorize(&mut matrix, size);
    matrix
}

/// Rounds the coefficients of a channel from the last to the first by `round`, a function of the coefficient's index,
/// its value, the shift that makes up for the errors so far and the curvature of the error, R².
fn round_channel(sh: &mut [f32], channel: usize, metric: &[f64], round: impl Fn(usize, f64, f64, f64) -> f64) {
    let size = sh.len() / 3;
    let mut errors = [0.0; sh_coefficient_count(3)];
    for k in (0..size).rev() {
        let value = f64::from(sh[3 * k + channel]);
        let diagonal = metric[k * size + k];
        let later: f64 = (k + 1..size).map(|j| metric[j * size + k] * errors[j]).sum();
        let pull = -later / diagonal;
        let rounded = if k == 0 {
            value + pull
        } else {
            round(k, value, pull, diagonal * diagonal)
        };
        errors[k] = rounded - value;
        sh[3 * k + channel] = rounded as f32;
    }
}

/// Grid of one coefficient.
#[derive(Clone, Copy)]
struct GridLine {
    step: f64,
    offset: f64,
    limit: f64,
}

impl GridLine {
    fn at(self, index: f64) -> f64 {
        (index * self.step + self.offset).clamp(-self.limit, self.limit)
    }
}

/// Value of the grid nearest to `value + pull`, at most `reach` steps from `value`; a smaller one if the bits saved are
/// worth the error: `bit_price` is the squared error that a bit is worth.
fn on_grid(value: f64, pull: f64, grid: GridLine, reach: f64, bit_price: f64) -> f64 {
    if grid.step <= 0.0 {
        return 0.0;
    }
    let target = value + pull.clamp(-reach * grid.step, reach * grid.step);
    let nearest = ((target - grid.offset) / grid.step).round();
    if bit_price <= 0.0 {
        return grid.at(nearest);
    }
    let cost = |index: f64| {
        let error = index * grid.step + grid.offset - target;
        error * error + bit_price * bits(index)
    };
    let candidates = [nearest, nearest - nearest.signum(), 0.0];
    let best = candidates.into_iter().min_by(|&a, &b| cost(a).total_cmp(&cost(b)));
    grid.at(best.unwrap_or(nearest))
}

/// Bits that a code takes, about: those of an exponential distribution.
fn bits(index: f64) -> f64 {
    if index == 0.0 { 0.0 } else { 2.0 + index.abs().log2() }
}
