//! Fit of exposures, and of vignetting with them, to observations of points.
//!
//! The model of an observation is y = e_i + x_p, and with vignetting + Σ a_k qᵏ of the lens and the place in the
//! picture. The unknowns e and a minimise Σ Huber(residual), x at its best, by ten rounds of reweighted least squares
//! with conjugate gradients. The mean of e is free.

use crate::stats::conjugate_gradients::{self, SymmetricSystem};

/// Rounds of reweighting.
const ROUNDS: usize = 10;

/// One channel of an observation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    pub(super) photo: usize,
    pub(super) point: usize,
    /// Logarithm y.
    pub(super) value: f64,
    /// Lens, and q and q², if its vignetting is an unknown.
    pub(super) lens: Option<(usize, [f64; 2])>,
}

/// Solution for one channel.
pub(super) struct TrackFit {
    /// e of each photograph.
    pub(super) photos: Vec<f64>,
    /// Coefficients a of each lens.
    pub(super) lenses: Vec<[f64; 2]>,
    /// Standard error of the sum of each lens's coefficients.
    pub(super) lens_errors: Vec<f64>,
    /// Observations of each photograph.
    pub(super) counts: Vec<usize>,
    /// Robust standard deviation of the residuals.
    pub(super) deviation: f64,
}

/// Numbers of photographs, lenses and points.
#[derive(Clone, Copy, Debug)]
pub(super) struct FitSize {
    pub(super) photos: usize,
    pub(super) lenses: usize,
    pub(super) points: usize,
}

impl TrackFit {
    pub(super) fn of(all: Vec<Observation>, size: FitSize) -> TrackFit {
        let all = &shared(all, size.points);
        let mut counts = vec![0; size.photos];
        all.iter().for_each(|s| counts[s.photo] += 1);
        let mut unknowns = vec![0.0; size.photos + 2 * size.lenses];
        let mut deviation = 0.0;
        let mut weights = vec![1.0; all.len()];
        for _ in 0..ROUNDS {
            let system = System::new(all, &weights, size);
            system.solve(&mut unknowns);
            let values = system.points(&unknowns);
            let residual = |s: &Observation| s.value - s.model(&unknowns, size.photos) - values[s.point];
            let residuals: Vec<f64> = all.iter().map(residual).collect();
            deviation = robust_deviation(&residuals);
            // Huber's limit for 95 % efficiency under normal noise.
            let limit = (1.345 * deviation).max(1e-6);
            let weight = |r: &f64| if r.abs() <= limit { 1.0 } else { limit / r.abs() };
            weights = residuals.iter().map(weight).collect();
        }
        let system = System::new(all, &weights, size);
        let lens_error = |lens| deviation * system.corner_variance(lens).sqrt();
        TrackFit {
            lens_errors: (0..size.lenses).map(lens_error).collect(),
            lenses: unknowns.split_off(size.photos).as_chunks().0.to_vec(),
            photos: unknowns,
            counts,
            deviation,
        }
    }
}

/// Those of points with at least two observations: one alone says nothing of exposures.
fn shared(mut all: Vec<Observation>, points: usize) -> Vec<Observation> {
    let mut count = vec![0_u32; points];
    all.iter().for_each(|s| count[s.point] += 1);
    all.retain(|s| count[s.point] > 1);
    all
}

impl Observation {
    /// The model without x, of unknowns that begin with those of `photos` photographs.
    fn model(&self, unknowns: &[f64], photos: usize) -> f64 {
        let dot = |(lens, powers): &(usize, [f64; 2])| {
            let coefficients = &unknowns[photos + 2 * lens..][..2];
            coefficients.iter().zip(powers).map(|(a, q)| a * q).sum::<f64>()
        };
        unknowns[self.photo] + self.lens.as_ref().map_or(0.0, dot)
    }

    /// Adds a multiple of the model's derivatives to the sums of the unknowns.
    fn add(&self, sums: &mut [f64], photos: usize, factor: f64) {
        sums[self.photo] += factor;
        if let Some((lens, powers)) = self.lens {
            let sums = sums[photos + 2 * lens..].iter_mut().zip(powers);
            sums.for_each(|(sum, q)| *sum += factor * q);
        }
    }
}

/// 1.4826 times the median of the absolute values.
fn robust_deviation(residuals: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Weighted least squares of one round, points eliminated.
struct System<'a> {
    all: &'a [Observation],
    weights: &'a [f64],
    size: FitSize,
    /// Diagonal of the matrix before the points are eliminated.
    diagonal: Vec<f64>,
    point_weight: Vec<f64>,
}

impl<'a> System<'a> {
    fn new(all: &'a [Observation], weights: &'a [f64], size: FitSize) -> System<'a> {
        let mut diagonal = vec![0.0; size.photos + 2 * size.lenses];
        let mut point_weight = vec![0.0; size.points];
        for (s, weight) in all.iter().zip(weights) {
            point_weight[s.point] += weight;
            let squares = Observation {
                lens: s.lens.map(|(lens, powers)| (lens, powers.map(|q| q * q))),
                ..*s
            };
            squares.add(&mut diagonal, size.photos, *weight);
        }
        System {
            all,
            weights,
            size,
            diagonal,
            point_weight,
        }
    }

    /// Weighted mean by point of `value` over its observations.
    fn by_point(&self, value: impl Fn(&Observation) -> f64) -> Vec<f64> {
        let mut sums = vec![0.0; self.point_weight.len()];
        for (s, weight) in self.all.iter().zip(self.weights) {
            sums[s.point] += weight * value(s);
        }
        let of = |(sum, weight): (f64, &f64)| if *weight > 0.0 { sum / weight } else { 0.0 };
        sums.into_iter().zip(&self.point_weight).map(of).collect()
    }

    /// x of each point, given the unknowns.
    fn points(&self, unknowns: &[f64]) -> Vec<f64> {
        self.by_point(|s| s.value - s.model(unknowns, self.size.photos))
    }

    /// Sums by unknown of the weighted `value`.
    fn by_unknown(&self, value: impl Fn(&Observation) -> f64) -> Vec<f64> {
        let mut sums = vec![0.0; self.diagonal.len()];
        for (s, weight) in self.all.iter().zip(self.weights) {
            s.add(&mut sums, self.size.photos, weight * value(s));
        }
        sums
    }

    /// Minimiser from a start; the mean of e is free.
    fn solve(&self, unknowns: &mut [f64]) {
        let points = self.points(unknowns);
        // Half the negative gradient by the unknowns, with every point at its best.
        let residual = self.by_unknown(|s| s.value - s.model(unknowns, self.size.photos) - points[s.point]);
        self.improve(unknowns, residual);
    }

    /// Variance of the sum of a lens's coefficients, for residuals of variance 1.
    fn corner_variance(&self, lens: usize) -> f64 {
        let own = self.size.photos + 2 * lens..self.size.photos + 2 * lens + 2;
        let mut ones = vec![0.0; self.diagonal.len()];
        ones[own.clone()].fill(1.0);
        let mut solution = vec![0.0; ones.len()];
        self.improve(&mut solution, ones);
        solution[own].iter().sum()
    }

    fn improve(&self, unknowns: &mut [f64], residual: Vec<f64>) {
        let end = 1e-24 * self.diagonal.iter().sum::<f64>();
        let iterations = 4 * unknowns.len() + 20;
        conjugate_gradients::improve(self, unknowns, residual, |_| end, iterations);
    }
}

impl SymmetricSystem for System<'_> {
    fn product(&self, direction: &[f64]) -> Vec<f64> {
        let model = |s: &Observation| s.model(direction, self.size.photos);
        let means = self.by_point(model);
        self.by_unknown(|s| model(s) - means[s.point])
    }

    fn precondition(&self, residual: &[f64]) -> Vec<f64> {
        let of = |(r, weight): (&f64, &f64)| if *weight > 0.0 { r / weight } else { 0.0 };
        residual.iter().zip(&self.diagonal).map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Observations of a chain: each point in three neighbouring photographs, with noise and a share of outliers.
    fn chain(photos: usize, noise: f64, outliers: f64) -> (Vec<Observation>, Vec<f64>, usize) {
        let mut state = 3_u32;
        let mut unit = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24)
        };
        let mut gains: Vec<f64> = (0..photos).map(|_| unit() - 0.5).collect();
        let mean = gains.iter().sum::<f64>() / photos as f64;
        gains.iter_mut().for_each(|gain| *gain -= mean);
        let (mut all, points) = (Vec::new(), 40 * photos);
        for point in 0..points {
            let color = -2.0 * unit();
            for (photo, gain) in gains.iter().enumerate().skip(point / 40).take(3) {
                let outlier = if unit() < outliers { 2.0 } else { 0.0 };
                let value = color + gain + noise * (unit() - 0.5) + outlier;
                all.push(Observation {
                    photo,
                    point,
                    value,
                    lens: None,
                });
            }
        }
        (all, gains, points)
    }

    fn without_lens(photos: usize, points: usize) -> FitSize {
        FitSize {
            photos,
            lenses: 0,
            points,
        }
    }

    /// Largest difference up to a common constant.
    fn worst(found: &[f64], gains: &[f64]) -> f64 {
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        let differences = found.iter().zip(gains).map(|(a, b)| (a - mean - b).abs());
        differences.fold(0.0, f64::max)
    }

    #[test]
    fn a_long_chain_is_solved_exactly() {
        let (all, gains, points) = chain(300, 0.0, 0.0);
        let fit = TrackFit::of(all, without_lens(300, points));
        assert!(worst(&fit.photos, &gains) < 1e-8, "{}", worst(&fit.photos, &gains));
    }

    #[test]
    fn gains_are_found_through_noise_and_outliers() {
        let (all, gains, points) = chain(12, 0.2, 0.05);
        let fit = TrackFit::of(all.clone(), without_lens(12, points));
        let robust = worst(&fit.photos, &gains);
        // Noise of 0.058 over about 114 observations a photograph, along a chain of 12.
        assert!(robust < 0.04, "{robust}");
        assert!((0.02..0.12).contains(&fit.deviation), "{}", fit.deviation);
        let mut plain = vec![0.0; 12];
        System::new(&all, &vec![1.0; all.len()], without_lens(12, points)).solve(&mut plain);
        assert!(robust < 0.5 * worst(&plain, &gains), "outliers weigh nothing");
    }

    #[test]
    fn nothing_seen_twice_tells_nothing() {
        let lone = |photo| Observation {
            photo,
            point: photo,
            value: -1.0,
            lens: None,
        };
        let all = shared(vec![lone(0), lone(1)], 2);
        let fit = TrackFit::of(all, without_lens(2, 2));
        assert_eq!((fit.photos, fit.deviation), (vec![0.0; 2], 0.0));
    }

    #[test]
    fn vignetting_is_found_beside_exposures() {
        let truth = [-0.05, -0.17];
        let (photos, points, noise) = (24, 400, 0.05);
        let mut state = 9_u32;
        let mut unit = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24)
        };
        let mut all = Vec::new();
        for point in 0..points {
            let color = -2.0 * unit();
            for photo in (0..photos).filter(|photo| (photo + point) % 4 == 0) {
                let q = unit();
                let powers = [q, q * q];
                let fall: f64 = truth.iter().zip(powers).map(|(a, q)| a * q).sum();
                all.push(Observation {
                    photo,
                    point,
                    value: color + 0.02 * photo as f64 + fall + noise * (unit() - 0.5),
                    lens: Some((0, powers)),
                });
            }
        }
        let size = FitSize {
            photos,
            lenses: 1,
            points,
        };
        let fit = TrackFit::of(all, size);
        let corner = fit.lenses[0].iter().sum::<f64>() + 0.22;
        // Four standard errors, which are of the order of the noise over the root of a few hundred.
        let error = fit.lens_errors[0];
        assert!(
            (1e-4..5e-3).contains(&error) && corner.abs() < 4.0 * error,
            "{corner} {error}"
        );
        let middle: f64 = fit.lenses[0].iter().zip([0.5, 0.25]).map(|(a, q)| a * q).sum();
        assert!((middle + 0.0675).abs() < 0.005, "{middle}");
    }
}
