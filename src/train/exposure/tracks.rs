//! Exposures from the tracks of the sparse points, before any training: one point has one colour, up to the exposure of
//! each photograph that shows it.
//!
//! An observation of point p in photograph i is y = ln(v + 0.055) of the mean v over 3 × 3 pixels. The model is
//! y = e_i + x_p; e and x minimise Σ Huber(y − e_i − x_p) with Σ e_i = 0 ([`fit`](super::fit)). The points are
//! eliminated and the photographs' equations are solved by conjugate gradients, so that a long chain of photographs
//! converges as well as a ring. Nothing is random.

use super::center;
use super::colors::TrackColors;
use super::fit::{FitSize, TrackFit};

/// Fewest observations of a photograph that are trusted.
const OBSERVATIONS_MIN: usize = 20;

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

/// Exposures of the training photographs, in the order of their views; empty with less than two photographs.
pub fn from_tracks(colors: &TrackColors) -> Vec<TrackExposure> {
    if colors.photos.len() < 2 {
        return Vec::new();
    }
    let size = FitSize {
        photos: colors.photos.len(),
        lenses: 0,
        points: colors.points,
    };
    let mut exposures: Vec<TrackExposure> = colors
        .photos
        .iter()
        .map(|photo| TrackExposure {
            view: photo.view,
            log_gain: [0.0; 3],
            error: 0.0,
            observations: usize::MAX,
        })
        .collect();
    for channel in 0..3 {
        let all = colors.observations(channel, |_| None, |patch| patch.point);
        let fit = TrackFit::of(all, size);
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
    exposures
}
