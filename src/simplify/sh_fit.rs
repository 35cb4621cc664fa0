//! Least-squares fit of lower SH degrees to the views of each splat.
//!
//! A splat is seen from few directions, for which fewer coefficients may do. For each degree d, b are the coefficients
//! nearest to the colours c in the least-squares sense, weighted by the splat's weight in each view:
//!
//! E(d) = min_b Σ_v w_v (c(v) − b · Y(v))² + μ W ∫ (c − b · Y)² dΩ / 4π,  W = Σ_v w_v,
//!
//! as if μ times the total weight came from all directions alike. Colours are fitted with a small μ, which only settles
//! directions without a view. Degrees are chosen with a large one: coefficients that training has made large are
//! needed, even if others can replace them in the given views. Each splat takes the degree of least E(d) + λ n(d), n
//! the number of coefficients: the least total error at that total count, which λ controls.
//!
//! The rule hardly matters after some hundred steps: half of the SH of the fox costs 0.08 to 0.12 dB by each of ten
//! such rules, by this one 0.08 and 0.10 (`2026-11-22-harmonics.csv`).

use crate::render::Slots;
use crate::scene::{Camera, Splats, sh_basis, sh_coefficient_count};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// μ of the fitted colours.
const FITTED_ALL_ROUND: f64 = 1e-3;

/// μ of the choice of degrees.
const CHOSEN_ALL_ROUND: f64 = 1.0;

/// Bisection steps for log₂ λ: to 2⁻⁴⁰ of the interval.
const HALVINGS: usize = 40;

/// Number of SH degrees, 0 to 3.
const DEGREES: usize = 4;

/// A view with each splat's weight in it, summed over pixels.
pub struct ViewWeights {
    /// Camera of the view.
    pub camera: Camera,
    /// Weight of each splat.
    pub weights: Vec<f32>,
}

/// Fitted colours and errors of every splat at every lower degree.
pub struct Fits {
    rows: Vec<Fit>,
    sh_degree: u32,
}

/// Fit of one splat, by degree up to the scene's.
#[derive(Clone, Default)]
struct Fit {
    /// `[coefficient][rgb]`.
    rows: Vec<Vec<f32>>,
    /// E(d).
    errors: Vec<f64>,
}

impl Fits {
    /// Fits the colours of all splats.
    ///
    /// Panics unless each view has a weight for every splat.
    pub fn new(splats: &Splats, views: &[ViewWeights]) -> Fits {
        assert!(views.iter().all(|v| v.weights.len() == splats.len()));
        let fit = |i: usize| fit(splats, i, views);
        Fits {
            rows: (0..splats.len()).into_par_iter().map(fit).collect(),
            sh_degree: splats.sh_degree,
        }
    }

    /// Degrees of least total error within `floats` floats, or degree 0 where even that takes more. Each degree but the
    /// highest in use has `apart` splats or none.
    pub fn degrees(&self, floats: usize, apart: usize) -> Vec<u8> {
        let sets = 1..1 << (self.sh_degree + 1);
        let choices = sets.map(|set| self.within(floats, set));
        let choices = choices.filter(|degrees| {
            let counts = Slots::of(degrees).counts;
            let highest = counts.iter().rposition(|&count| count > 0).unwrap_or(0);
            let are_apart = |&count: &usize| count == 0 || count >= apart;
            count(degrees) <= floats && counts[..highest].iter().all(are_apart)
        });
        let errors = choices.map(|degrees| (self.error(&degrees), degrees));
        let least = errors.min_by(|a, b| a.0.total_cmp(&b.0));
        least.map_or_else(|| vec![0; self.rows.len()], |(_, degrees)| degrees)
    }

    /// Degrees of least total error from `set` (one bit per degree) within `floats` floats, if the lowest degree in the
    /// set fits.
    fn within(&self, floats: usize, set: u32) -> Vec<u8> {
        let (mut low, mut high) = (-60.0_f64, 60.0_f64);
        for _ in 0..HALVINGS {
            let middle = (low + high) / 2.0;
            match count(&self.choose(set, middle.exp2())) > floats {
                true => low = middle,
                false => high = middle,
            }
        }
        self.choose(set, high.exp2())
    }

    fn choose(&self, set: u32, lambda: f64) -> Vec<u8> {
        let choose = |fit: &Fit| {
            // NaN stays, unrepaired.
            if fit.errors.iter().any(|e| e.is_nan()) {
                return self.sh_degree as u8;
            }
            let all = fit.errors.iter().enumerate();
            let chosen = all.filter(|(degree, _)| set >> degree & 1 == 1);
            let cost = |(d, e): (usize, &f64)| (e + lambda * floats(d as u8) as f64, d);
            let least = chosen.map(cost).min_by(|a, b| a.0.total_cmp(&b.0));
            least.map_or(0, |(_, degree)| degree as u8)
        };
        self.rows.par_iter().map(choose).collect()
    }

    fn error(&self, degrees: &[u8]) -> f64 {
        let pairs = self.rows.iter().zip(degrees);
        let errors = pairs.map(|(fit, &degree)| fit.errors[degree as usize]);
        errors.filter(|error| !error.is_nan()).sum()
    }

    /// The scene at these degrees, in its own layout; dropped coefficients are zero.
    ///
    /// Panics unless there is a degree for every splat.
    pub fn applied(&self, splats: &Splats, degrees: &[u8]) -> Splats {
        assert_eq!(splats.len(), degrees.len(), "one degree per splat");
        let mut splats = splats.clone();
        let stride = splats.sh_stride();
        let rows = splats.sh.chunks_exact_mut(stride);
        for ((row, fit), &degree) in rows.zip(&self.rows).zip(degrees) {
            let fitted = &fit.rows[degree as usize];
            row[..fitted.len()].copy_from_slice(fitted);
            row[fitted.len()..].fill(0.0);
        }
        splats
    }
}

/// Floats of a colour at a degree.
fn floats(degree: u8) -> usize {
    3 * sh_coefficient_count(degree.into())
}

/// Floats of all colours.
pub(super) fn count(degrees: &[u8]) -> usize {
    degrees.iter().map(|&degree| floats(degree)).sum()
}

fn fit(splats: &Splats, index: usize, views: &[ViewWeights]) -> Fit {
    let stride = splats.sh_stride();
    let row = &splats.sh[index * stride..][..stride];
    let mean = DVec3::from(splats.mean[index].map(f64::from));
    let seen: Vec<(f64, [f64; 16])> = views
        .iter()
        .filter(|view| view.weights[index] > 0.0)
        .map(|view| {
            let direction = (mean - view.camera.position).normalize_or(DVec3::Z);
            let values = sh_basis(direction.to_array());
            (f64::from(view.weights[index]), values)
        })
        .collect();
    let mut found = Fit::default();
    for degree in 0..splats.sh_degree {
        let fewer = |all_round| fewer(row, &seen, sh_coefficient_count(degree), all_round);
        let (fitted, _) = fewer(FITTED_ALL_ROUND);
        let (_, error) = fewer(CHOSEN_ALL_ROUND);
        found.rows.push(fitted);
        found.errors.push(error);
    }
    found.rows.push(row.to_vec());
    // The full degree: no error, or NaN if any coefficient is not finite.
    let total: f32 = row.iter().map(|c| c * 0.0).sum();
    found.errors.push(f64::from(total));
    debug_assert!(found.rows.len() <= DEGREES);
    found
}

/// The first `count` coefficients of best fit, and their error E; `all_round` is μ.
fn fewer(row: &[f32], seen: &[(f64, [f64; 16])], count: usize, all_round: f64) -> (Vec<f32>, f64) {
    let total: f64 = seen.iter().map(|(weight, _)| weight).sum();
    let around = all_round * total / (4.0 * PI);
    let at = |channel: usize| row.iter().skip(channel).step_by(3).map(|&c| f64::from(c));
    if total.is_nan() || total <= 0.0 {
        return (row[..3 * count].to_vec(), 0.0);
    }
    let mut matrix = vec![0.0; count * count];
    for (weight, values) in seen {
        for i in 0..count {
            for j in 0..=i {
                matrix[i * count + j] += weight * values[i] * values[j];
            }
        }
    }
    (0..count).for_each(|i| matrix[i * count + i] += around);
    factorize(&mut matrix, count);
    let mut fitted = vec![0.0; 3 * count];
    let mut error = 0.0;
    for channel in 0..3 {
        let own: Vec<f64> = at(channel).collect();
        let color = |values: &[f64]| own.iter().zip(values).map(|(c, y)| c * y).sum::<f64>();
        let mut best: Vec<f64> = own[..count].iter().map(|c| around * c).collect();
        for (weight, values) in seen {
            let color = weight * color(values);
            let sums = best.iter_mut().zip(values);
            sums.for_each(|(sum, value)| *sum += color * value);
        }
        solve(&matrix, &mut best);
        for (weight, values) in seen {
            let off = color(values) - best.iter().zip(values).map(|(b, y)| b * y).sum::<f64>();
            error += weight * off * off;
        }
        for (k, own) in own.iter().enumerate() {
            error += around * (own - best.get(k).unwrap_or(&0.0)).powi(2);
        }
        for (k, &b) in best.iter().enumerate() {
            fitted[3 * k + channel] = b as f32;
        }
    }
    (fitted, error)
}

/// Cholesky factor: replaces a symmetric positive definite matrix by its lower triangle L, with L Lᵀ the matrix.
pub(crate) fn factorize(matrix: &mut [f64], size: usize) {
    for i in 0..size {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| matrix[i * size + k] * matrix[j * size + k]).sum();
            let rest = matrix[i * size + j] - dot;
            matrix[i * size + j] = match i == j {
                true => rest.sqrt(),
                false => rest / matrix[j * size + j],
            };
        }
    }
}

/// Solves L Lᵀ x = b, b in place.
fn solve(lower: &[f64], b: &mut [f64]) {
    let size = b.len();
    for i in 0..size {
        let dot: f64 = (0..i).map(|k| lower[i * size + k] * b[k]).sum();
        b[i] = (b[i] - dot) / lower[i * size + i];
    }
    for i in (0..size).rev() {
        let dot: f64 = (i + 1..size).map(|k| lower[k * size + i] * b[k]).sum();
        b[i] = (b[i] - dot) / lower[i * size + i];
    }
}

#[cfg(test)]
mod tests {
    use super::super::sh_error::tests::scene as with_colors;
    use super::*;

    /// Splats of degree 3 at the origin with deterministic coefficients.
    fn scene(count: usize) -> Splats {
        let value = |i: usize| ((i * 7919 + 13) % 1009) as f32 / 1009.0 - 0.5;
        let sh: Vec<f32> = (0..48 * count).map(value).collect();
        with_colors(sh.as_chunks().0)
    }

    /// Views from `places`, each with these weights for the splats.
    fn views(places: &[[f64; 3]], weights: &[f32]) -> Vec<ViewWeights> {
        let view = |&place: &[f64; 3]| ViewWeights {
            camera: Camera {
                width: 1,
                height: 1,
                focal: glam::DVec2::ONE,
                center: glam::DVec2::ONE,
                rotation: glam::DMat3::IDENTITY,
                position: DVec3::from(place),
            },
            weights: weights.to_vec(),
        };
        places.iter().map(view).collect()
    }

    fn color(splats: &Splats, index: usize, from: [f64; 3]) -> [f64; 3] {
        let direction = (-DVec3::from(from)).normalize();
        let values = sh_basis(direction.to_array());
        let row = &splats.sh[48 * index..][..48];
        [0, 1, 2].map(|c| (0..16).map(|k| f64::from(row[3 * k + c]) * values[k]).sum())
    }

    #[test]
    fn one_view_needs_one_coefficient() {
        let place = [1.0, 2.0, -3.0];
        let splats = scene(1);
        let fits = Fits::new(&splats, &views(&[place], &[4.0]));
        let flat = fits.applied(&splats, &[0]);
        let off = |splats: &Splats| {
            let pairs = color(splats, 0, place).into_iter().zip(color(&scene(1), 0, place));
            pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>()
        };
        let mut cut = splats.clone();
        cut.sh[3..].fill(0.0);
        // A thousandth of the weight is all round: a millionth of the error of truncation.
        assert!(off(&flat) < 2e-6 * off(&cut), "{} of {}", off(&flat), off(&cut));
        assert!(flat.sh[3..].iter().all(|&c| c == 0.0));
    }

    #[test]
    fn errors_fall_with_the_degree_and_are_what_they_say() {
        let places: Vec<[f64; 3]> = (0..12)
            .map(|i| [(i as f64).sin(), (i as f64 * 1.7).cos(), 0.3 + (i as f64 * 0.9).sin()])
            .collect();
        let splats = scene(3);
        let fits = Fits::new(&splats, &views(&places, &[0.5, 2.0, 9.0]));
        for (index, weight) in [0.5, 2.0, 9.0].into_iter().enumerate() {
            let errors = &fits.rows[index].errors;
            assert!(errors.windows(2).all(|two| two[0] >= two[1]) && errors[3] == 0.0);
            let cut = fits.applied(&splats, &[1; 3]);
            let seen: f64 = places
                .iter()
                .map(|&p| {
                    let pairs = color(&cut, index, p).into_iter().zip(color(&splats, index, p));
                    weight * pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>()
                })
                .sum();
            assert!(seen <= errors[1] && errors[1] < 10.0 * seen + 1e-9);
        }
    }

    #[test]
    fn who_is_seen_most_keeps_most_and_the_budget_is_kept() {
        let mut splats = scene(2);
        let (first, second) = splats.sh.split_at_mut(48);
        second.copy_from_slice(first);
        let places = [[1.0, 0.0, 0.2], [0.0, 1.0, -0.4], [-1.0, 0.5, 1.0]];
        let fits = Fits::new(&splats, &views(&places, &[0.001, 100.0]));
        let degrees = fits.degrees(3 + 48, 1);
        assert_eq!(degrees, [0, 3]);
        assert_eq!(fits.degrees(96, 1), [3, 3]);
        assert_eq!(fits.degrees(6, 1), [0, 0]);
        for budget in [6, 20, 33, 50, 70, 96] {
            assert!(count(&fits.degrees(budget, 1)) <= budget);
        }
    }

    #[test]
    fn no_degree_but_the_highest_is_that_of_few() {
        let splats = scene(30);
        let weights: Vec<f32> = (0..30).map(|i| 1.3_f32.powi(i * 7 % 30)).collect();
        let places = [[1.0, 0.0, 0.2], [0.0, 1.0, -0.4], [-1.0, 0.5, 1.0]];
        let fits = Fits::new(&splats, &views(&places, &weights));
        for budget in [90, 200, 400, 720, 1_200] {
            let [free, bound] = [1, 8].map(|apart| fits.degrees(budget, apart));
            let counts = Slots::of(&bound).counts;
            let highest = counts.iter().rposition(|&count| count > 0).unwrap();
            let are_apart = counts[..highest].iter().all(|&c| c == 0 || c >= 8);
            assert!(are_apart, "{counts:?}");
            assert!(count(&bound) <= budget && count(&free) <= budget);
            assert!(fits.error(&free) <= fits.error(&bound));
        }
    }

    #[test]
    fn unseen_splats_and_broken_numbers_are_no_trouble() {
        let mut splats = scene(2);
        splats.sh[50] = f32::NAN;
        let fits = Fits::new(&splats, &views(&[[1.0, 0.0, 0.0]], &[0.0, 1.0]));
        let degrees = fits.degrees(51, 1);
        assert_eq!(degrees, [0, 3]);
        let applied = fits.applied(&splats, &degrees);
        assert!(applied.sh[50].is_nan() && applied.sh[..3] == splats.sh[..3]);
    }
}
