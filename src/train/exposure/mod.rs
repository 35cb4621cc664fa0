//! Exposure and white balance of photographs: a gain for each photograph and channel.
//!
//! A gain of 2^e in linear light, seen through the sRGB curve v = 1.055 L^(1/2.4) − 0.055, is v' + 0.055 = g (v +
//! 0.055) with g = 2^(e/2.4): affine in the stored values, with one number for each channel, and exact above the
//! curve's short linear toe. Logarithms of g are natural; a stop is 2.4 / ln 2 of them.
//!
//! **Invariant:** the mean of log gains over the training photographs is 0 in each channel: the brightness of the scene
//! depends neither on the order of photographs nor on the seed.

mod gains;
mod tracks;

pub use gains::ExposureGains;
pub use tracks::{TrackExposure, from_tracks};

/// Offset of the sRGB curve.
pub const CURVE_OFFSET: f64 = 0.055;

/// Exponent of the sRGB curve.
pub const CURVE_POWER: f64 = 2.4;

/// Stops in linear light of the logarithm of a gain.
pub fn stops(log_gain: f64) -> f64 {
    log_gain * CURVE_POWER / std::f64::consts::LN_2
}

/// Subtracts the mean over `gains` in each channel.
pub fn center(gains: &mut [[f64; 3]]) {
    let count = gains.len().max(1) as f64;
    for channel in 0..3 {
        let mean = gains.iter().map(|gain| gain[channel]).sum::<f64>() / count;
        gains.iter_mut().for_each(|gain| gain[channel] -= mean);
    }
}
