//! Gains of a run: from the tracks before the first step, then from the renderings.
//!
//! Each step adds the sums of its photograph (kernel `loss_exposure`). After each epoch the gain that brings a
//! rendering nearest to its photograph is Σ (x + 0.055)(y + 0.055) / Σ (x + 0.055)² in each channel; gains move halfway
//! there in the logarithm, and their mean is taken out. The last tenth of a run keeps them.
//!
//! Renderings know less than tracks do: in their least squares, highlights and edges count as exposure (a made scene
//! has errors of 0.08 stops rms by renderings and of 0.03 by tracks). So a photograph with tracks goes only a tenth of
//! the way from its first gain, and keeps it where the exposures of tracks hardly differ.

use super::{CURVE_POWER, TrackColors, center, from_tracks, stops};
use crate::Result;
use crate::scene::Dataset;
use serde::{Deserialize, Serialize};

/// Share of the way to the least-squares gain that an update goes.
const BLEND: f64 = 0.5;

/// Share of the way from the gain of the tracks to the least-squares gain.
const TRACKED_SHARE: f64 = 0.1;

/// Root mean square in stops below which the exposures of tracks count as none: highlights and edges alone give a made
/// scene of one exposure 0.03.
const TRACKED_MIN_STOPS: f64 = 0.05;

/// Least weight, in values of a channel, of a photograph that is updated.
const WEIGHT_MIN: f64 = 30.0;

/// Largest gain or reciprocal: three stops. Beyond it a photograph says nothing of the scene.
const LOG_GAIN_MAX: f64 = 3.0 * std::f64::consts::LN_2 / CURVE_POWER;

/// Gains of the training photographs, and sums since the last update.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExposureGains {
    /// Natural logarithm of each photograph's gains, in the order of the training views.
    pub log_gain: Vec<[f64; 3]>,
    /// The gains that the tracks told, if they did.
    pub tracked: Vec<Option<[f64; 3]>>,
    /// Products of each channel and the weight, and squares of each channel, of each photograph.
    pub sums: Vec<[[f64; 4]; 2]>,
}

impl ExposureGains {
    /// Gains from the tracks of the points, or 1 without tracks; `views` are the training views.
    ///
    /// # Errors
    /// Those of [`TrackColors::read`].
    pub fn begin(dataset: &Dataset, views: &[usize]) -> Result<ExposureGains> {
        let mut tracked = vec![None; views.len()];
        for found in from_tracks(&TrackColors::read(dataset)?)
            .iter()
            .filter(|found| found.is_trusted())
        {
            if let Ok(place) = views.binary_search(&found.view) {
                tracked[place] = Some(found.log_gain);
            }
        }
        Ok(ExposureGains::of(tracked))
    }

    /// The gains of the tracks, and 1 where they do not tell; the mean is taken out. All are 1 if they hardly differ.
    pub fn of(mut tracked: Vec<Option<[f64; 3]>>) -> ExposureGains {
        let known: Vec<f64> = tracked.iter().flatten().flatten().map(|&gain| stops(gain)).collect();
        let square = known.iter().map(|stop| stop * stop).sum::<f64>();
        if square < TRACKED_MIN_STOPS.powi(2) * known.len() as f64 {
            tracked.iter_mut().flatten().for_each(|gain| *gain = [0.0; 3]);
        }
        let mut log_gain: Vec<[f64; 3]> = tracked.iter().map(|gain| gain.unwrap_or_default()).collect();
        center(&mut log_gain);
        ExposureGains {
            sums: vec![Default::default(); log_gain.len()],
            tracked,
            log_gain,
        }
    }

    /// Gains of a photograph, and slopes on the toe of the curve, as the kernels read them.
    pub(crate) fn push(&self, photo: usize) -> [[f32; 3]; 2] {
        let power = |power: f64| self.log_gain[photo].map(|log| (power * log).exp() as f32);
        [power(1.0), power(CURVE_POWER)]
    }

    /// Adds a step's sums.
    pub(crate) fn add(&mut self, photo: usize, sums: &[[f32; 4]]) {
        for (all, new) in self.sums[photo].iter_mut().flatten().zip(sums.as_flattened()) {
            *all += f64::from(*new);
        }
    }

    /// Moves the gains towards those of the sums, and forgets the sums. A photograph without enough values that count,
    /// black, white or masked, keeps its gain.
    pub(crate) fn update(&mut self) {
        // Where the tracks tell no exposure, renderings would only bring their errors.
        let differ = self.tracked.iter().flatten().any(|gain| *gain != [0.0; 3]);
        let share = if differ { TRACKED_SHARE } else { 0.0 };
        let photos = self.log_gain.iter_mut().zip(&mut self.sums).zip(&self.tracked);
        for ((log_gain, sums), tracked) in photos {
            let [products, squares] = std::mem::take(sums);
            for channel in 0..3 {
                let best = (products[channel] / squares[channel]).ln();
                if products[3] >= WEIGHT_MIN && best.is_finite() {
                    let best = best.clamp(-LOG_GAIN_MAX, LOG_GAIN_MAX);
                    let from = |tracked: &[f64; 3]| tracked[channel] + share * (best - tracked[channel]);
                    let best = tracked.as_ref().map_or(best, from);
                    log_gain[channel] += BLEND * (best - log_gain[channel]);
                }
            }
        }
        center(&mut self.log_gain);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sums(gain: f64, weight: f32) -> [[f32; 4]; 2] {
        let squares = 0.25 * weight;
        let products = gain as f32 * squares;
        [[products, products, products, weight], [squares, squares, squares, 0.0]]
    }

    #[test]
    fn gains_converge_with_a_mean_of_zero() {
        let mut gains = ExposureGains::of(vec![None; 3]);
        let truth = [1.2, 0.9, 1.0 / (1.2 * 0.9)];
        for _ in 0..12 {
            for (photo, gain) in truth.into_iter().enumerate() {
                gains.add(photo, &sums(gain, 500.0));
            }
            gains.update();
        }
        for (log_gain, truth) in gains.log_gain.iter().zip(truth) {
            assert!((log_gain[1] - f64::ln(truth)).abs() < 1e-3, "{log_gain:?}");
        }
        let mean = gains.log_gain.iter().map(|gain| gain[2]).sum::<f64>() / 3.0;
        assert!(mean.abs() < 1e-12, "{mean}");
    }

    #[test]
    fn tracks_weigh_more_than_renderings() {
        let tracked = f64::ln(1.2);
        let mut gains = ExposureGains::of(vec![Some([tracked; 3]), Some([-tracked; 3])]);
        for _ in 0..20 {
            gains.add(0, &sums(1.0, 500.0));
            gains.add(1, &sums(1.0, 500.0));
            gains.update();
        }
        assert!((gains.log_gain[0][1] - 0.9 * tracked).abs() < 1e-3, "{gains:?}");
    }

    #[test]
    fn exposures_that_hardly_differ_are_none() {
        let of = |gain: f64| ExposureGains::of(vec![Some([gain; 3]), Some([-gain; 3]), None]).log_gain[0];
        assert_eq!(of(0.01), [0.0; 3]);
        assert_eq!(of(0.02), [0.02; 3]);
    }

    #[test]
    fn renderings_give_no_exposure_where_tracks_tell_none() {
        let mut gains = ExposureGains::of(vec![Some([0.01; 3]), Some([-0.01; 3]), None]);
        gains.add(0, &sums(1.2, 500.0));
        gains.update();
        assert_eq!(gains.log_gain, vec![[0.0; 3]; 3]);
        // One without tracks has only its renderings.
        gains.add(2, &sums(1.2, 500.0));
        gains.update();
        assert!(
            gains.log_gain[2][1] > 0.05 && gains.log_gain[0] == gains.log_gain[1],
            "{gains:?}"
        );
    }

    #[test]
    fn photographs_that_say_nothing_keep_their_gain() {
        let mut gains = ExposureGains::of(vec![Some([0.1; 3]), Some([-0.1; 3])]);
        let before = gains.clone();
        gains.add(0, &sums(3.0, 10.0));
        gains.add(1, &[[0.0; 4]; 2]);
        gains.update();
        assert_eq!(gains, before);
        gains.add(0, &[[f32::NAN; 4]; 2]);
        gains.update();
        assert_eq!(gains, before, "poison stays out");
    }
}
