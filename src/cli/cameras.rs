//! Cameras of two data sets of the same photographs, side by side.

use super::args::DataArgs;
use crate::scene::{Camera, Dataset, PoseDifference, Similarity, Split};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Training cameras of a data set, beside those of another of the same names.
pub(super) struct CameraPairs {
    names: Vec<String>,
    own: Vec<Camera>,
    others: Vec<Camera>,
    extent: f64,
}

impl CameraPairs {
    /// Reads the other data set, of which photographs are not needed.
    ///
    /// # Errors
    /// Those of reading it, and too few photographs in common.
    pub(super) fn read(dataset: &Dataset, options: &DataArgs, path: &Path) -> Result<CameraPairs> {
        let mut other = options.open(path, false)?;
        other.set_origin(dataset.origin);
        let cameras: BTreeMap<&str, &Camera> = other.views.iter().map(|v| (v.name.as_str(), &v.camera)).collect();
        let mut pairs = CameraPairs {
            names: Vec::new(),
            own: Vec::new(),
            others: Vec::new(),
            extent: dataset.extent(),
        };
        for view in dataset.split(Split::Train) {
            let view = &dataset.views[view];
            if let Some(camera) = cameras.get(view.name.as_str()) {
                pairs.names.push(view.name.clone());
                pairs.own.push(view.camera);
                pairs.others.push(**camera);
            }
        }
        if pairs.names.len() < 3 {
            let what = format!(
                "has {} of the training photographs; three are needed",
                pairs.names.len()
            );
            return Err(Error::file(path, what));
        }
        Ok(pairs)
    }

    /// The similarity from the data set's cameras to the other ones.
    pub(super) fn similarity(&self) -> Similarity {
        Similarity::between(&self.own, &self.others)
    }

    /// The other cameras by name.
    pub(super) fn others(&self) -> BTreeMap<&str, &Camera> {
        self.names.iter().map(String::as_str).zip(&self.others).collect()
    }

    /// Differences that no similarity explains, as text and JSON.
    pub(super) fn describe(&self) -> (String, Value) {
        let similarity = self.similarity();
        let pairs = self.own.iter().zip(&self.others);
        let differences: Vec<PoseDifference> = pairs
            .map(|(own, other)| PoseDifference::of(&similarity.moved(own), other))
            .collect();
        let percent = |distance: f64| 100.0 * distance / (self.extent * similarity.scale);
        let rms = PoseDifference::rms(&differences);
        let listed = self.names.iter().zip(&differences);
        let largest = listed.clone().max_by(|a, b| a.1.degrees.total_cmp(&b.1.degrees));
        let (name, most) = largest.map_or(("", PoseDifference::default()), |(name, most)| (name, *most));
        let text = format!(
            "cameras:  {} beside the others: {:.4}° and {:.4} % of the extent (rms) after the similarity of scale {:.6} \
             and {:.4}°; most turned: {name} by {:.4}°",
            differences.len(),
            rms.degrees,
            percent(rms.distance),
            similarity.scale,
            similarity.degrees(),
            most.degrees,
        );
        let value = json!({
            "rms_degrees": rms.degrees,
            "rms_percent_of_extent": percent(rms.distance),
            "similarity": similarity_value(&similarity),
            "photos": listed
                .map(|(name, of)| json!({
                    "name": name,
                    "degrees": of.degrees,
                    "percent_of_extent": percent(of.distance),
                    "turn_degrees": of.turn.to_array(),
                    "shift_percent_of_extent": of.shift.to_array().map(percent),
                }))
                .collect::<Vec<_>>(),
        });
        (text, value)
    }
}

/// A similarity as JSON.
pub(super) fn similarity_value(similarity: &Similarity) -> Value {
    json!({
        "scale": similarity.scale,
        "rotation_degrees": similarity.degrees(),
        "translation": similarity.translation.to_array(),
    })
}
