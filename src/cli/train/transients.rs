//! Ignored patches of a run: `ignored/`, `transients.json`, and a line of text.

use crate::cli::output::{file_stem, write_text};
use crate::scene::{Dataset, Split, View};
use crate::train::transients::IgnoredPatches;
use crate::{Error, Result, io};
use serde_json::{Value, json};
use std::path::Path;

/// Photographs named in the line of text.
const NAMED: usize = 3;

/// Writes a mask for each photograph with ignored patches (white keeps, as in `masks/`), and the shares of all. Returns
/// the line of text and the JSON of the report.
pub(super) fn write(dir: &Path, dataset: &Dataset, patches: &IgnoredPatches) -> Result<(String, Value)> {
    let masks = dir.join("ignored");
    // Those of an earlier run.
    if masks.is_dir() {
        std::fs::remove_dir_all(&masks).map_err(Error::io(&masks))?;
    }
    let mut shares = Vec::new();
    for (place, view) in dataset.split(Split::Train).into_iter().enumerate() {
        let view = &dataset.views[view];
        let share = patches.share(place);
        if share > 0.0 {
            std::fs::create_dir_all(&masks).map_err(Error::io(&masks))?;
            write_mask(&masks, view, place, patches)?;
        }
        shares.push((view.name.as_str(), share));
    }
    let mean = shares.iter().map(|(_, share)| share).sum::<f64>() / shares.len().max(1) as f64;
    let touched = shares.iter().filter(|(_, share)| *share > 0.0).count();
    let summary = json!({"share": mean, "photographs": touched});
    let mut value = summary.clone();
    value["photos"] = shares
        .iter()
        .map(|(name, share)| json!({"name": name, "share": share}))
        .collect();
    write_text(&dir.join("transients.json"), &format!("{value:#}\n"))?;
    let all = shares.len();
    shares.sort_by(|a, b| b.1.total_cmp(&a.1));
    let most = shares.iter().take(NAMED.min(touched));
    let most: Vec<String> = most
        .map(|(name, share)| format!("{name} {:.0} %", 100.0 * share))
        .collect();
    let line = match most.is_empty() {
        true => "transients: none found, all of the photographs count".into(),
        false => format!(
            "transients: {:.1} % of the photographs ignored, in {touched} of {all}; most: {}",
            100.0 * mean,
            most.join(", ")
        ),
    };
    Ok((line, summary))
}

fn write_mask(masks: &Path, view: &View, place: usize, patches: &IgnoredPatches) -> Result<()> {
    let (width, height) = (view.camera.width, view.camera.height);
    let grid = patches.grid(place);
    let pixels: Vec<[f32; 3]> = (0..height)
        .flat_map(|y| (0..width).map(move |x| grid.place(x, y)))
        .map(|patch| [f32::from(u8::from(!patches.is_ignored(place, patch))); 3])
        .collect();
    let path = masks.join(file_stem(&view.name) + ".png");
    io::png::write_rgb(&path, width, height, &pixels)
}
