//! Exposure and white balance of photographs: a gain for each photograph and channel.
//!
//! A gain of 2^e in linear light is affine in the stored values, with one number g = 2^(e/2.4) for each channel
//! ([`CURVE_OFFSET`]).
//!
//! **Invariant:** the mean of log gains over the training photographs is 0 in each channel: the brightness of the scene
//! depends neither on the order of photographs nor on the seed.

mod colors;
mod fit;
mod gains;
mod lens;
mod tracks;

pub use crate::scene::{CURVE_OFFSET, CURVE_POWER, stops};
pub use colors::TrackColors;
pub use gains::ExposureGains;
pub use lens::{LensVignetting, remove_vignetting, vignetting};
pub use tracks::{TrackExposure, from_tracks};

/// Subtracts the mean over `gains` in each channel.
pub fn center(gains: &mut [[f64; 3]]) {
    let count = gains.len().max(1) as f64;
    for channel in 0..3 {
        let mean = gains.iter().map(|gain| gain[channel]).sum::<f64>() / count;
        gains.iter_mut().for_each(|gain| gain[channel] -= mean);
    }
}
