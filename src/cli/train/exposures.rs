//! Exposures of a run's photographs: `exposures.json`, and a line of text.

use crate::Result;
use crate::cli::output::write_text;
use crate::scene::{Dataset, Split};
use crate::train::exposure::{CURVE_OFFSET, CURVE_POWER, ExposureGains, stops};
use serde_json::json;
use std::path::Path;

/// Writes the gains of each training photograph: stored value + offset, over that of the scene; and stops in linear
/// light.
pub(super) fn write(dir: &Path, dataset: &Dataset, gains: &ExposureGains) -> Result<()> {
    let photos = dataset.split(Split::Train).into_iter().zip(&gains.log_gain);
    let photos = photos.map(|(view, log_gain)| {
        json!({
            "name": dataset.views[view].name,
            "gain": log_gain.map(f64::exp),
            "stops": log_gain.map(stops),
        })
    });
    let value = json!({
        "model": "gain",
        "curve_offset": CURVE_OFFSET,
        "curve_power": CURVE_POWER,
        "photos": photos.collect::<Vec<_>>(),
    });
    write_text(&dir.join("exposures.json"), &format!("{value:#}\n"))
}

/// Number of photographs and range of their exposures.
pub(super) fn line(gains: &ExposureGains) -> String {
    let levels = || gains.log_gain.iter().map(|gain| stops(gain.iter().sum::<f64>() / 3.0));
    let range = levels().fold(f64::MIN, f64::max) - levels().fold(f64::MAX, f64::min);
    match gains.tracked.iter().all(Option::is_none) {
        true => "exposure: no tracks tell it, gains of the photographs begin at 1".into(),
        false => format!("exposure: {} photographs within {range:.2} stops", gains.log_gain.len()),
    }
}
