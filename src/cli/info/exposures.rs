//! Exposures of the training photographs and vignetting of their lenses, from the tracks of the points.

use crate::cli::args::vignetting_line;
use crate::scene::Dataset;
use crate::train::exposure::{self, LensVignetting, TrackColors, TrackExposure, from_tracks, stops};
use serde_json::{Value, json};

/// Root mean square in stops from which exposures differ visibly: a tenth of a stop is 3 % of a value.
const RMS_MIN: f64 = 0.1;

/// Photographs up to which all are listed; of more, the darkest and the brightest.
const LISTED_MAX: usize = 40;

/// Text and JSON; `None` without tracks.
pub(super) fn describe(dataset: &Dataset, colors: &TrackColors) -> Option<(String, Value)> {
    let found = from_tracks(colors);
    if found.is_empty() {
        return None;
    }
    let rows: Vec<ExposureRow<'_>> = found.iter().map(|of| ExposureRow::of(dataset, of)).collect();
    let all = rows.iter().flat_map(|row| row.stops);
    let rms = (all.map(|stop| stop * stop).sum::<f64>() / (3 * rows.len()) as f64).sqrt();
    let levels = || rows.iter().map(ExposureRow::level);
    let range = levels().fold(f64::MIN, f64::max) - levels().fold(f64::MAX, f64::min);
    let differ = rms >= RMS_MIN;
    let text = match differ {
        true => table(&rows, range, rms),
        false => format!("exposure: within {range:.2} stops (rms {rms:.3}, from the points' tracks)"),
    };
    let value = json!({
        "range_stops": range,
        "rms_stops": rms,
        "differ": differ,
        "photos": rows.iter().map(ExposureRow::value).collect::<Vec<_>>(),
    });
    Some((text, value))
}

/// Vignetting of each lens, text and JSON; `None` without tracks or with few photographs.
pub(super) fn vignetting(colors: &TrackColors) -> Option<(String, Value)> {
    let lenses = exposure::vignetting(colors);
    let mut text = lenses.iter().map(vignetting_line).collect::<Vec<_>>().join("\n");
    if lenses.iter().any(LensVignetting::is_clear) {
        text += ": --vignetting removes it";
    }
    let values = lenses.iter().map(|lens| {
        json!({
            "size": lens.size,
            "photos": lens.photos,
            "coefficients": lens.vignetting.coefficients,
            "is_clear": lens.is_clear(),
            "corner_stops": lens.vignetting.corner_stops(),
            "error_stops": lens.error_stops,
        })
    });
    (!lenses.is_empty()).then(|| (text, values.collect()))
}

/// A photograph of the table.
struct ExposureRow<'a> {
    name: &'a str,
    /// Red, green, blue.
    stops: [f64; 3],
    error: f64,
    observations: usize,
}

impl<'a> ExposureRow<'a> {
    fn of(dataset: &'a Dataset, of: &TrackExposure) -> ExposureRow<'a> {
        ExposureRow {
            name: &dataset.views[of.view].name,
            stops: of.log_gain.map(stops),
            error: stops(of.error),
            observations: of.observations,
        }
    }

    /// Mean over the channels.
    fn level(&self) -> f64 {
        self.stops.iter().sum::<f64>() / 3.0
    }

    fn value(&self) -> Value {
        json!({
            "name": self.name,
            "stops": self.stops,
            "error_stops": self.error,
            "observations": self.observations,
        })
    }

    fn line(&self, width: usize) -> String {
        let [red, green, blue] = self.stops;
        format!(
            "  {:width$} {:>+7.2} {:>+7.2} {:>+7.2} {:>7.3} {:>12}\n",
            self.name,
            self.level(),
            red - green,
            blue - green,
            self.error,
            self.observations
        )
    }
}

fn table(rows: &[ExposureRow<'_>], range: f64, rms: f64) -> String {
    let mut listed: Vec<&ExposureRow<'_>> = rows.iter().collect();
    let is_cut = listed.len() > LISTED_MAX;
    if is_cut {
        listed.sort_by(|a, b| a.level().total_cmp(&b.level()));
    }
    let width = rows
        .iter()
        .map(|row| row.name.chars().count())
        .max()
        .unwrap_or(0)
        .max(10);
    let mut text = String::from("exposure: of the training photographs in stops, from the points' tracks\n");
    text += &format!(
        "  {:width$} {:>7} {:>7} {:>7} {:>7} {:>12}\n",
        "photograph", "all", "red", "blue", "error", "observations"
    );
    for (place, row) in listed.iter().enumerate() {
        let is_left_out = is_cut && (LISTED_MAX / 2..listed.len() - LISTED_MAX / 2).contains(&place);
        if !is_left_out {
            text += &row.line(width);
        } else if place == LISTED_MAX / 2 {
            text += &format!("  … {} between\n", listed.len() - LISTED_MAX);
        }
    }
    text + &format!("  exposures differ by {range:.2} stops (rms {rms:.2}): train with --exposure")
}
