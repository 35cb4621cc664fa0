//! Refined poses of a run: `refined/`, `poses.json`, and a line of text.

use crate::Result;
use crate::cli::output::write_text;
use crate::io::refined::{self, PoseMotions};
use crate::scene::{Dataset, PoseDifference, Split};
use crate::train::poses::{RefinedPoses, photo_name};
use serde_json::{Value, json};
use std::path::Path;

/// Photographs named in the line of text.
const NAMED: usize = 3;

/// Motion of each photograph from its given pose.
struct PhotoMotion<'a> {
    name: &'a str,
    difference: PoseDifference,
}

/// Writes the data set's reconstruction with the refined poses, and the motion of each photograph: degrees, and percent
/// of the scene extent. Returns the line of text and the JSON of the report.
pub(super) fn write(dir: &Path, data: &Path, dataset: &Dataset, poses: &RefinedPoses) -> Result<(String, Value)> {
    let (mut motions, mut moved) = (PoseMotions::new(), Vec::new());
    for (place, (view, difference)) in dataset
        .split(Split::Train)
        .into_iter()
        .zip(poses.differences())
        .enumerate()
    {
        let name = photo_name(&dataset.views[view].name);
        if motions.insert(name.to_owned(), poses.motion(place)).is_none() {
            moved.push(PhotoMotion { name, difference });
        }
    }
    refined::write(data, &dir.join("refined"), &motions)?;
    let all: Vec<PoseDifference> = moved.iter().map(|of| of.difference).collect();
    let rms = PoseDifference::rms(&all);
    let percent = |difference: &PoseDifference| 100.0 * difference.distance / dataset.extent();
    let summary = json!({
        "rms_degrees": rms.degrees,
        "rms_percent_of_extent": percent(&rms),
        "gauge": "least squares to the given poses",
    });
    let mut value = summary.clone();
    let photo = |of: &PhotoMotion<'_>| {
        json!({
            "name": of.name,
            "degrees": of.difference.degrees,
            "percent_of_extent": percent(&of.difference),
        })
    };
    value["photos"] = moved.iter().map(photo).collect();
    write_text(&dir.join("poses.json"), &format!("{value:#}\n"))?;
    moved.sort_by(|a, b| b.difference.degrees.total_cmp(&a.difference.degrees));
    let most = moved.iter().take(NAMED).map(|of| {
        let (degrees, percent) = (of.difference.degrees, percent(&of.difference));
        format!("{} {degrees:.2}° {percent:.2} %", of.name)
    });
    let line = format!(
        "poses: moved by {:.3}° and {:.3} % of the extent (rms); most: {}",
        rms.degrees,
        percent(&rms),
        most.collect::<Vec<_>>().join(", ")
    );
    Ok((line, summary))
}
