//! Exposures from the tracks of the sparse points, before any training: one point has one colour, up to the exposure of
//! each photograph that shows it.
//!
//! An observation of point p in photograph i is y = ln(v + 0.055) of the mean v over 3 × 3 pixels. The model is
//! y = e_i + x_p; e and x minimise Σ Huber(y − e_i − x_p) with Σ e_i = 0, by ten rounds of reweighted least squares. In
//! each, the points are eliminated and the photographs' equations are solved by conjugate gradients, so that a long
//! chain of photographs converges as well as a ring. Nothing is random.

use super::{CURVE_OFFSET, center};
use crate::Result;
use crate::io::photo;
use crate::scene::{Dataset, PhotoSource, Split};
use crate::stats::conjugate_gradients::{self, SymmetricSystem};
use glam::DVec3;
use rayon::prelude::*;

/// Values of an observation: outside of these, the sensor or the curve's toe says little.
const VALUES: std::ops::Range<f64> = 0.05..0.97;

/// Fewest observations of a photograph that are trusted.
const OBSERVATIONS_MIN: usize = 20;

/// Rounds of reweighting.
const ROUNDS: usize = 10;

/// Exposure of a photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackExposure {
    /// Index of the view in the data set.
    pub view: usize,
    /// Natural logarithm of the gain of each channel, in stored values; their mean over photographs is 0.
    pub log_gain: [f64; 3],
    /// Standard error of `log_gain`, the largest of the channels.
    pub error: f64,
    /// Observations used, the fewest of the channels. Below 20 the gain is left at 1.
    pub observations: usize,
}

impl TrackExposure {
    /// Whether the photograph has enough observations.
    pub fn is_trusted(&self) -> bool {
        self.observations >= OBSERVATIONS_MIN
    }
}

/// One channel of an observation.
#[derive(Clone, Copy, Debug)]
struct Observation {
    photo: usize,
    point: usize,
    value: f64,
}

/// Exposures of the training photographs, in the order of their views; empty without tracks or with less than two
/// photographs. Test views take no part.
///
/// # Errors
/// Those of a photograph that cannot be read.
pub fn from_tracks(dataset: &Dataset) -> Result<Vec<TrackExposure>> {
    let has_photo = |&view: &usize| !matches!(dataset.views[view].photo, PhotoSource::Absent);
    let views: Vec<usize> = dataset.split(Split::Train).into_iter().filter(has_photo).collect();
    if dataset.tracks.is_empty() || views.len() < 2 {
        return Ok(Vec::new());
    }
    let seen = views.par_iter().map(|&view| observations(dataset, view));
    let seen: Vec<Vec<(usize, [f64; 3])>> = seen.collect::<Result<_>>()?;
    let mut exposures: Vec<TrackExposure> = views
        .iter()
        .map(|&view| TrackExposure {
            view,
            log_gain: [0.0; 3],
            error: 0.0,
            observations: usize::MAX,
        })
        .collect();
    for channel in 0..3 {
        let all: Vec<Observation> = seen
            .iter()
            .enumerate()
            .flat_map(|(photo, list)| list.iter().map(move |(point, values)| (photo, *point, values[channel])))
            .filter(|(_, _, value)| VALUES.contains(value))
            .map(|(photo, point, value)| Observation {
                photo,
                point,
                value: (value + CURVE_OFFSET).ln(),
            })
            .collect();
        let fit = TrackFit::of(&shared(all, dataset.points.len()), views.len(), dataset.points.len());
        for (photo, exposure) in exposures.iter_mut().enumerate() {
            exposure.log_gain[channel] = fit.photos[photo];
            exposure.observations = exposure.observations.min(fit.counts[photo]);
            let error = fit.deviation / (fit.counts[photo].max(1) as f64).sqrt();
            exposure.error = exposure.error.max(error);
        }
    }
    for few in exposures.iter_mut().filter(|exposure| !exposure.is_trusted()) {
        few.log_gain = [0.0; 3];
    }
    let mut gains: Vec<[f64; 3]> = exposures.iter().map(|exposure| exposure.log_gain).collect();
    center(&mut gains);
    let with_gains = exposures.iter_mut().zip(gains);
    with_gains.for_each(|(exposure, gain)| exposure.log_gain = gain);
    Ok(exposures)
}

/// Means over 3 × 3 pixels about each point that a view sees.
fn observations(dataset: &Dataset, view: usize) -> Result<Vec<(usize, [f64; 3])>> {
    let listed = &dataset.views[view];
    let photo = photo::load(listed)?;
    let at = |&point: &u32| {
        let position = DVec3::from(dataset.points[point as usize].position);
        let pixel = listed.camera.pixel_from_world(position)?;
        Some((point as usize, photo.patch(pixel)?))
    };
    Ok(dataset.tracks[view].iter().filter_map(at).collect())
}

/// Those of points with at least two observations: one alone says nothing of exposures.
fn shared(mut all: Vec<Observation>, points: usize) -> Vec<Observation> {
    let mut count = vec![0_u32; points];
    all.iter().for_each(|s| count[s.point] += 1);
    all.retain(|s| count[s.point] > 1);
    all
}

/// Solution for one channel.
struct TrackFit {
    /// e of each photograph.
    photos: Vec<f64>,
    /// Observations of each photograph.
    counts: Vec<usize>,
    /// Robust standard deviation of the residuals.
    deviation: f64,
}

impl TrackFit {
    fn of(all: &[Observation], photos: usize, points: usize) -> TrackFit {
        let mut counts = vec![0; photos];
        all.iter().for_each(|s| counts[s.photo] += 1);
        let mut fit = TrackFit {
            photos: vec![0.0; photos],
            counts,
            deviation: 0.0,
        };
        let mut weights = vec![1.0; all.len()];
        for _ in 0..ROUNDS {
            let system = System::new(all, &weights, photos, points);
            system.solve(&mut fit.photos);
            let values = system.points(&fit.photos);
            let residual = |s: &Observation| s.value - fit.photos[s.photo] - values[s.point];
            let residuals: Vec<f64> = all.iter().map(residual).collect();
            fit.deviation = deviation(&residuals);
            // Huber's limit for 95 % efficiency under normal noise.
            let limit = (1.345 * fit.deviation).max(1e-6);
            let weight = |r: &f64| if r.abs() <= limit { 1.0 } else { limit / r.abs() };
            weights = residuals.iter().map(weight).collect();
        }
        fit
    }
}

/// 1.4826 times the median of the absolute values.
fn deviation(residuals: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Weighted least squares of one round.
struct System<'a> {
    all: &'a [Observation],
    weights: &'a [f64],
    photo_weight: Vec<f64>,
    point_weight: Vec<f64>,
}

impl<'a> System<'a> {
    fn new(all: &'a [Observation], weights: &'a [f64], photos: usize, points: usize) -> System<'a> {
        let (mut photo_weight, mut point_weight) = (vec![0.0; photos], vec![0.0; points]);
        for (s, weight) in all.iter().zip(weights) {
            photo_weight[s.photo] += weight;
            point_weight[s.point] += weight;
        }
        System {
            all,
            weights,
            photo_weight,
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

    /// x of each point, given e.
    fn points(&self, photos: &[f64]) -> Vec<f64> {
        self.by_point(|s| s.value - photos[s.photo])
    }

    /// Sums by photograph of the weighted `value`.
    fn by_photo(&self, value: impl Fn(&Observation) -> f64) -> Vec<f64> {
        let mut sums = vec![0.0; self.photo_weight.len()];
        for (s, weight) in self.all.iter().zip(self.weights) {
            sums[s.photo] += weight * value(s);
        }
        sums
    }

    /// Minimiser e from a start; its mean is free.
    fn solve(&self, photos: &mut [f64]) {
        let points = self.points(photos);
        // Half the negative gradient by e, with every point at its best.
        let residual = self.by_photo(|s| s.value - photos[s.photo] - points[s.point]);
        let end = 1e-24 * self.photo_weight.iter().sum::<f64>();
        let iterations = 4 * photos.len() + 20;
        conjugate_gradients::improve(self, photos, residual, |_| end, iterations);
    }
}

impl SymmetricSystem for System<'_> {
    fn product(&self, direction: &[f64]) -> Vec<f64> {
        let means = self.by_point(|s| direction[s.photo]);
        self.by_photo(|s| direction[s.photo] - means[s.point])
    }

    fn precondition(&self, residual: &[f64]) -> Vec<f64> {
        let of = |(r, weight): (&f64, &f64)| if *weight > 0.0 { r / weight } else { 0.0 };
        residual.iter().zip(&self.photo_weight).map(of).collect()
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
                all.push(Observation { photo, point, value });
            }
        }
        (shared(all, points), gains, points)
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
        let fit = TrackFit::of(&all, 300, points);
        assert!(worst(&fit.photos, &gains) < 1e-8, "{}", worst(&fit.photos, &gains));
    }

    #[test]
    fn gains_are_found_through_noise_and_outliers() {
        let (all, gains, points) = chain(12, 0.2, 0.05);
        let fit = TrackFit::of(&all, 12, points);
        let robust = worst(&fit.photos, &gains);
        // Noise of 0.058 over about 114 observations a photograph, along a chain of 12.
        assert!(robust < 0.04, "{robust}");
        assert!((0.02..0.12).contains(&fit.deviation), "{}", fit.deviation);
        let mut plain = vec![0.0; 12];
        System::new(&all, &vec![1.0; all.len()], 12, points).solve(&mut plain);
        assert!(robust < 0.5 * worst(&plain, &gains), "outliers weigh nothing");
    }

    #[test]
    fn nothing_seen_twice_tells_nothing() {
        let lone = |photo| Observation {
            photo,
            point: photo,
            value: -1.0,
        };
        let all = shared(vec![lone(0), lone(1)], 2);
        let fit = TrackFit::of(&all, 2, 2);
        assert_eq!((fit.photos, fit.deviation), (vec![0.0; 2], 0.0));
    }
}
