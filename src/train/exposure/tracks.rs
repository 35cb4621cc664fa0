//! Exposures from the tracks of the sparse points, before any training: one point has one colour, up to the exposure of
//! each photograph that shows it.
//!
//! An observation of point p in photograph i is y = ln(v + 0.055) of the mean v over 3 × 3 pixels. The model is
//! y = e_i + x_p; e and x minimise Σ Huber(y − e_i − x_p) with Σ e_i = 0 ([`fit`](super::fit)). The points are
//! eliminated and the photographs' equations are solved by conjugate gradients, so that a long chain of photographs
//! converges as well as a ring. Nothing is random.

use super::fit::{FitSize, Observation, TrackFit, shared};
use super::{CURVE_OFFSET, center};
use crate::Result;
use crate::io::photo;
use crate::scene::{Dataset, PhotoSource, Split, Vignetting};
use glam::DVec3;
use rayon::prelude::*;

/// Values of an observation: outside of these, the sensor or the curve's toe says little.
const VALUES: std::ops::Range<f64> = 0.05..0.97;

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

/// Exposures of the training photographs, in the order of their views; empty without tracks or with less than two
/// photographs. Test views take no part.
///
/// # Errors
/// Those of a photograph that cannot be read.
pub fn from_tracks(dataset: &Dataset) -> Result<Vec<TrackExposure>> {
    let views = photographed(dataset);
    if dataset.tracks.is_empty() || views.len() < 2 {
        return Ok(Vec::new());
    }
    let seen = patches(dataset, &views)?;
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
        let all = observations(&seen, channel, dataset.points.len(), |_| None);
        let size = FitSize {
            photos: views.len(),
            lenses: 0,
            points: dataset.points.len(),
        };
        let fit = TrackFit::of(&all, size);
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

/// Training views with a photograph.
pub(super) fn photographed(dataset: &Dataset) -> Vec<usize> {
    let has_photo = |&view: &usize| !matches!(dataset.views[view].photo, PhotoSource::Absent);
    dataset.split(Split::Train).into_iter().filter(has_photo).collect()
}

/// Mean over 3 × 3 pixels about a point.
pub(super) struct PatchColor {
    pub(super) point: usize,
    /// Values of the channels.
    values: [f64; 3],
    /// q and q² of the place in the picture.
    powers: [f64; 2],
    /// Unit vector from the point to the camera.
    pub(super) direction: DVec3,
}

/// Patches about the points that each view sees.
pub(super) fn patches(dataset: &Dataset, views: &[usize]) -> Result<Vec<Vec<PatchColor>>> {
    views.par_iter().map(|&view| patches_of(dataset, view)).collect()
}

fn patches_of(dataset: &Dataset, view: usize) -> Result<Vec<PatchColor>> {
    let listed = &dataset.views[view];
    let photo = photo::load(listed)?;
    let at = |&point: &u32| {
        let position = DVec3::from(dataset.points[point as usize].position);
        let pixel = listed.camera.pixel_from_world(position)?;
        Some(PatchColor {
            point: point as usize,
            values: photo.patch(pixel)?,
            powers: Vignetting::powers(&listed.camera, pixel),
            direction: (listed.camera.position - position).normalize_or_zero(),
        })
    };
    Ok(dataset.tracks[view].iter().filter_map(at).collect())
}

/// Observations of a channel, of each photograph's lens where its vignetting is an unknown.
pub(super) fn observations(
    patches: &[Vec<PatchColor>],
    channel: usize,
    points: usize,
    lens: impl Fn(usize) -> Option<usize>,
) -> Vec<Observation> {
    let all = patches.iter().enumerate().flat_map(|(photo, list)| {
        let lens = lens(photo);
        let known = list.iter().filter(move |patch| VALUES.contains(&patch.values[channel]));
        known.map(move |patch| Observation {
            photo,
            point: patch.point,
            value: (patch.values[channel] + CURVE_OFFSET).ln(),
            lens: lens.map(|lens| (lens, patch.powers)),
        })
    });
    shared(all.collect(), points)
}
