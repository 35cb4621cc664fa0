//! Faults of real captures in made photographs, with the truth known.

use super::random::KeyedRandom;
use crate::scene::{Camera, Vignetting, linear_to_srgb, srgb_to_linear};
use glam::DVec2;

/// Largest exposure of a photograph in stops, either way.
const EXPOSURE_STOPS: f64 = 1.0;

/// Largest white balance in stops, of red and of blue, either way.
const BALANCE_STOPS: f64 = 0.25;

/// Loss of light of a made lens in the corners, stops.
pub(super) const VIGNETTING_STOPS: f64 = 0.7;

/// Loss of light of a made lens at a place in pixels, stops: half with the squared distance from the principal point,
/// half with its square.
pub(super) fn vignetting(camera: &Camera, pixel: DVec2) -> f64 {
    let [q, square] = Vignetting::powers(camera, pixel);
    0.5 * VIGNETTING_STOPS * (q + square)
}

/// Exposure of each view's red, green and blue in stops of linear light: 0 in test views, else uniform within one stop
/// for all channels, and within a quarter for red and blue alone. The mean over the training views is 0 in each
/// channel.
pub(super) fn exposures(views: usize, is_test: impl Fn(usize) -> bool, seed: u64) -> Vec<[f64; 3]> {
    let draw = |view: usize| {
        let mut random = KeyedRandom::new(seed, view as u64);
        let mut uniform = |reach: f64| random.between(-reach, reach);
        let (all, red, blue) = (uniform(EXPOSURE_STOPS), uniform(BALANCE_STOPS), uniform(BALANCE_STOPS));
        [all + red, all, all + blue]
    };
    let mut stops: Vec<[f64; 3]> = (0..views).map(draw).collect();
    let training: Vec<usize> = (0..views).filter(|&view| !is_test(view)).collect();
    let mean = [0, 1, 2].map(|c| training.iter().map(|&v| stops[v][c]).sum::<f64>() / training.len().max(1) as f64);
    for (view, stops) in stops.iter_mut().enumerate() {
        for (stop, mean) in stops.iter_mut().zip(mean) {
            *stop = if is_test(view) { 0.0 } else { *stop - mean };
        }
    }
    stops
}

/// The colour under another exposure: sRGB values, through linear light. Values above 1 are left for the photograph to
/// clip.
pub(super) fn exposed(color: [f32; 3], stops: [f64; 3]) -> [f32; 3] {
    [0, 1, 2].map(|c| linear_to_srgb(srgb_to_linear(color[c].into()) * stops[c].exp2()) as f32)
}
