//! Harmonics of a splat, rounded together.
//!
//! With Y the basis in the direction of a view and w the splat's weight there, rounding errors Δ of a channel change
//! the picture by Δᵀ G Δ, G = Σ w Y Yᵀ / Σ w + 1/4π. The second part is the mean over all directions, for views from
//! elsewhere. The constant coefficient follows the others, δ₀ = −Σ G₀ⱼ δⱼ / G₀₀, which leaves the Schur complement S of
//! G for them. They are rounded from the last to the first, each to the grid point nearest to the value that makes up
//! for the errors so far (Babai's nearest plane); then single coefficients and pairs move by a step as long as that
//! lowers Δᵀ S Δ and the price of the bits.

use super::influence::Influence;
use crate::scene::{Splats, sh_basis, sh_coefficient_count};
use crate::simplify::factorize;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Values that a format has for harmonics above degree 0.
#[derive(Clone, Copy, Debug)]
pub enum HarmonicGrid<'a> {
    /// Multiples of a step plus an offset.
    Steps {
        /// Highest degree that is kept.
        degree: u32,
        /// Step of a splat of mean weight w = 1. Others have powers of two near step/√w, which share the bits so that
        /// the picture's error is least.
        step: f64,
        /// Finest and coarsest step.
        range: [f64; 2],
        /// Value nearest to zero from above.
        offset: f64,
        /// Least value beyond the codes.
        end: f64,
        /// Price of a bit in squared steps: dead zone of the coefficients.
        bit_price: f64,
    },
    /// Given values in the layout of [`Splats::sh`]: only the constant coefficient follows.
    Given(&'a [f32]),
}

/// Most passes over the moves of a channel; few need more than three.
const PASSES: usize = 8;

/// Largest error of a coefficient, steps.
const ERROR_MAX: f64 = 1.5;

/// Coefficients above degree 0, at most.
const REST: usize = sh_coefficient_count(3) - 1;

/// Splats with harmonics above degree 0 on a grid, and constant ones that make up for the errors in the views.
///
/// # Panics
/// If `influence` has another number of splats.
pub fn round_harmonics(splats: &Splats, influence: &Influence, grid: HarmonicGrid<'_>) -> Splats {
    let stride = splats.sh_stride();
    let mut rounded = splats.clone();
    rounded.sh.par_chunks_exact_mut(stride).enumerate().for_each(|(i, sh)| {
        let metric = metric(influence, i, splats.mean[i], splats.sh_degree);
        let weight = influence.of(i);
        for channel in 0..3 {
            let mut values = [0.0; REST];
            let old = sh[3..].iter().skip(channel).step_by(3);
            values.iter_mut().zip(old).for_each(|(v, &c)| *v = c.into());
            let found = match grid {
                HarmonicGrid::Given(given) => {
                    let given = &given[i * stride..][..stride];
                    std::array::from_fn(|k| given.get(3 * (k + 1) + channel).map_or(0.0, |&v| v.into()))
                }
                HarmonicGrid::Steps {
                    degree,
                    step,
                    range,
                    offset,
                    end,
                    bit_price,
                } => {
                    let own = step_of(step, weight, range);
                    let lines = std::array::from_fn(|k| GridLine {
                        step: if (k + 1).isqrt() as u32 <= degree { own } else { 0.0 },
                        offset,
                        limit: end - own,
                    });
                    metric.round(&values, &lines, bit_price * step * step / weight)
                }
            };
            let mut shift = 0.0;
            for k in 0..metric.size {
                shift += metric.constant[k] * (found[k] - values[k]);
                sh[3 * (k + 1) + channel] = found[k] as f32;
            }
            sh[channel] -= shift as f32;
        }
    });
    rounded
}

/// Step of a splat of this relative weight: the power of two nearest to step/√weight within the range.
pub(super) fn step_of(step: f64, weight: f64, [finest, coarsest]: [f64; 2]) -> f64 {
    let wanted = step / weight.sqrt();
    wanted.log2().round().exp2().clamp(finest, coarsest)
}

/// Metric of the coefficients of a splat above degree 0.
fn metric(influence: &Influence, splat: usize, mean: [f32; 3], degree: u32) -> Metric {
    let size = sh_coefficient_count(degree);
    let mut matrix = [0.0; 256];
    let mut total = 0.0;
    for (weight, direction) in influence.views(splat, mean) {
        let basis = sh_basis(direction.to_array());
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
    (0..size).for_each(|i| matrix[i * size + i] += 1.0 / (4.0 * PI));
    Metric::new(&matrix, size)
}

/// Squared error of the coefficients above degree 0, the constant one following.
struct Metric {
    /// Number of coefficients.
    size: usize,
    /// Share of an error of each coefficient that the constant one takes back.
    constant: [f64; REST],
    /// Schur complement, by rows.
    matrix: [[f64; REST]; REST],
    /// Its lower triangular factor.
    lower: Vec<f64>,
}

impl Metric {
    /// Metric of a symmetric matrix over all coefficients, of which the lower triangle is given.
    fn new(all: &[f64], size: usize) -> Metric {
        let rest = size - 1;
        let at = |i: usize, j: usize| all[i.max(j) * size + i.min(j)];
        let mut matrix = [[0.0; REST]; REST];
        let mut lower = vec![0.0; rest * rest];
        for i in 0..rest {
            for j in 0..rest {
                matrix[i][j] = at(i + 1, j + 1) - at(i + 1, 0) * at(j + 1, 0) / at(0, 0);
                lower[i * rest + j] = matrix[i][j];
            }
        }
        factorize(&mut lower, rest);
        Metric {
            size: rest,
            constant: std::array::from_fn(|k| if k < rest { at(k + 1, 0) / at(0, 0) } else { 0.0 }),
            matrix,
            lower,
        }
    }

    /// Values on the grid of least error and price.
    fn round(&self, values: &[f64; REST], lines: &[GridLine; REST], price: f64) -> [f64; REST] {
        let mut codes = [0.0; REST];
        let mut errors = [0.0; REST];
        for k in (0..self.size).rev() {
            let later: f64 = (k + 1..self.size)
                .map(|j| self.lower[j * self.size + k] * errors[j])
                .sum();
            let pull = -later / self.lower[k * self.size + k];
            codes[k] = lines[k].code(values[k] + pull.clamp(-lines[k].step, lines[k].step));
            errors[k] = lines[k].value(codes[k]) - values[k];
        }
        let mut search = LatticeSearch {
            metric: self,
            lines,
            price,
            gradient: std::array::from_fn(|i| (0..self.size).map(|j| self.matrix[i][j] * errors[j]).sum()),
            codes,
            errors,
        };
        for _ in 0..PASSES {
            if !search.improve() {
                break;
            }
        }
        std::array::from_fn(|k| lines[k].value(search.codes[k]))
    }
}

/// Search for codes of lower error.
struct LatticeSearch<'a> {
    metric: &'a Metric,
    lines: &'a [GridLine; REST],
    price: f64,
    codes: [f64; REST],
    errors: [f64; REST],
    /// Half the gradient of the error.
    gradient: [f64; REST],
}

impl LatticeSearch<'_> {
    /// Moves coefficients and pairs by a step where that is better; whether any moved.
    fn improve(&mut self) -> bool {
        let mut moved = false;
        let size = self.metric.size;
        for i in 0..size {
            for up in [-1.0, 1.0] {
                let Some((first, cost)) = self.move_of(i, up) else {
                    continue;
                };
                if cost < -COST_MIN {
                    self.apply(i, up, first);
                    moved = true;
                    break;
                }
                let partner = (i + 1..size).find_map(|j| {
                    // The partner goes where it makes up for the first.
                    let other_up = -(first * self.metric.matrix[i][j]).signum();
                    let (second, other) = self.move_of(j, other_up)?;
                    let both = cost + other + 2.0 * first * second * self.metric.matrix[i][j];
                    (both < -COST_MIN).then_some((j, other_up, second))
                });
                if let Some((j, other_up, second)) = partner {
                    self.apply(i, up, first);
                    self.apply(j, other_up, second);
                    moved = true;
                    break;
                }
            }
        }
        moved
    }

    /// Change of a coefficient by a step up or down, and of the cost; `None` beyond its range.
    fn move_of(&self, k: usize, up: f64) -> Option<(f64, f64)> {
        let line = self.lines[k];
        let (old, new) = (self.codes[k], self.codes[k] + up);
        let by = line.value(new) - line.value(old);
        if line.step <= 0.0 || by == 0.0 || (self.errors[k] + by).abs() > ERROR_MAX * line.step {
            return None;
        }
        let error = by * (2.0 * self.gradient[k] + by * self.metric.matrix[k][k]);
        Some((by, error + self.price * (bits(new) - bits(old))))
    }

    fn apply(&mut self, k: usize, up: f64, by: f64) {
        self.codes[k] += up;
        self.errors[k] += by;
        for i in 0..self.metric.size {
            self.gradient[i] += by * self.metric.matrix[i][k];
        }
    }
}

/// Least change of a cost that is worth a move: rounding errors of the sums must not move codes to and fro.
const COST_MIN: f64 = 1e-12;

/// HarmonicGrid of one coefficient.
#[derive(Clone, Copy)]
struct GridLine {
    step: f64,
    offset: f64,
    limit: f64,
}

impl GridLine {
    /// Nearest code.
    fn code(self, value: f64) -> f64 {
        match self.step > 0.0 {
            true => ((value.clamp(-self.limit, self.limit) - self.offset) / self.step).round(),
            false => 0.0,
        }
    }

    /// Value of a code.
    fn value(self, code: f64) -> f64 {
        match self.step > 0.0 {
            true => (code * self.step + self.offset).clamp(-self.limit, self.limit),
            false => 0.0,
        }
    }
}

/// Bits that a code takes, about: those of an exponential distribution.
fn bits(code: f64) -> f64 {
    if code == 0.0 { 0.0 } else { 2.0 + code.abs().log2() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Splats of degree 3 at the origin with harmonics within ±0.5.
    fn splats(count: usize) -> Splats {
        let value = |i: usize| ((i * 7919 + 13) % 1009) as f32 / 1009.0 - 0.5;
        Splats {
            mean: vec![[0.0; 3]; count],
            quaternion: vec![[1.0, 0.0, 0.0, 0.0]; count],
            log_scale: vec![[0.0; 3]; count],
            opacity_logit: vec![0.0; count],
            sh: (0..48 * count).map(value).collect(),
            sh_degree: 3,
            ..Splats::default()
        }
    }

    /// Cameras within half a radian of the z axis, each with the same weight for every splat.
    fn influence(count: usize) -> Influence {
        let positions: Vec<DVec3> = (0..12)
            .map(|i| {
                let angle = f64::from(i) * 2.4;
                DVec3::new(0.4 * angle.cos(), 0.4 * angle.sin() * f64::from(i % 3) / 2.0, -1.0)
            })
            .collect();
        Influence::of_weights(&positions, &vec![vec![4.0; count]; 12])
    }

    /// One step for all splats.
    fn grid(bit_price: f64) -> HarmonicGrid<'static> {
        HarmonicGrid::Steps {
            degree: 3,
            step: 0.125,
            range: [0.125; 2],
            offset: 0.0,
            end: 1.0,
            bit_price,
        }
    }

    fn color(sh: &[f32], direction: DVec3) -> f64 {
        let red = sh.iter().step_by(3);
        red.zip(sh_basis(direction.to_array()))
            .map(|(c, y)| f64::from(*c) * y)
            .sum()
    }

    /// Mean squared change of red in the directions of the views, and in all.
    fn errors(a: &Splats, b: &Splats, influence: &Influence) -> [f64; 2] {
        let rows = || a.sh.chunks_exact(48).zip(b.sh.chunks_exact(48)).enumerate();
        let (mut seen, mut views, mut all) = (0.0, 0.0, 0.0);
        for (i, (a, b)) in rows() {
            for (_, direction) in influence.views(i, [0.0; 3]) {
                seen += (color(a, direction) - color(b, direction)).powi(2);
                views += 1.0;
            }
            let squares = a.iter().zip(b).step_by(3).map(|(a, b)| f64::from(a - b).powi(2));
            all += squares.sum::<f64>() / (4.0 * PI);
        }
        [seen / views, all / rows().count() as f64]
    }

    fn plain(splats: &Splats) -> Splats {
        let mut rounded = splats.clone();
        for (i, value) in rounded.sh.iter_mut().enumerate() {
            if i % 48 >= 3 {
                *value = (*value / 0.125).round() * 0.125;
            }
        }
        rounded
    }

    #[test]
    fn colours_are_closer_in_the_views_and_not_much_farther_elsewhere() {
        let (splats, influence) = (splats(50), influence(50));
        let rounded = round_harmonics(&splats, &influence, grid(0.0));
        for (i, value) in rounded.sh.iter().enumerate().filter(|(i, _)| i % 48 >= 3) {
            assert_eq!((value / 0.125).fract(), 0.0, "{i}");
        }
        let [together, alone] = [&rounded, &plain(&splats)].map(|r| errors(&splats, r, &influence));
        // 4 dB less in the views, and 1 dB more as a mean over the sphere.
        assert!(together[0] < 0.4 * alone[0], "{together:?}, {alone:?}");
        assert!(together[1] < 1.25 * alone[1], "{together:?}, {alone:?}");
    }

    #[test]
    fn heavy_splats_have_finer_steps() {
        let steps = [1.0, 4.0, 16.0, 1e9, 0.0].map(|weight| step_of(0.1, weight, [1.0 / 128.0, 0.25]));
        assert_eq!(steps, [0.125, 0.0625, 0.03125, 1.0 / 128.0, 0.25]);
    }

    #[test]
    fn a_price_makes_zeros() {
        let (splats, influence) = (splats(20), influence(20));
        let zeros = |bit_price| {
            let rounded = round_harmonics(&splats, &influence, grid(bit_price));
            rounded.sh.iter().filter(|v| **v == 0.0).count()
        };
        assert!(zeros(0.0) < zeros(0.1) && zeros(0.1) < zeros(1.0));
    }

    #[test]
    fn the_constant_follows_given_values() {
        let (splats, influence) = (splats(50), influence(50));
        let given = plain(&splats);
        let rounded = round_harmonics(&splats, &influence, HarmonicGrid::Given(&given.sh));
        let differs = |(i, (a, b)): (usize, (&f32, &f32))| i % 48 >= 3 && a != b;
        assert!(!rounded.sh.iter().zip(&given.sh).enumerate().any(differs));
        let [followed, left] = [&rounded, &given].map(|r| errors(&splats, r, &influence)[0]);
        assert!(followed < left, "{followed}, {left}");
    }
}
