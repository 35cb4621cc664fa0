//! COLMAP's binary model of a made data set, with the tracks of its points, and the truth of its perturbations.

use super::SynthOptions;
use super::save::save_photo;
use crate::error::{Error, Result};
use crate::scene::{Dataset, Photo, PhotoSource, View};
use glam::DQuat;
use serde_json::json;
use std::path::Path;

/// Writes `dataset`, with photographs in memory, to the folder `dir`: `images/NAME.png`, the model in `sparse/0`. Every
/// camera has an entry of its own; 2D points are exact projections. With perturbations, `truth.json` has the stops of
/// each photograph's red, green and blue. Existing files of these names are replaced.
pub fn save_colmap(dataset: &Dataset, options: &SynthOptions, dir: &Path) -> Result<()> {
    for view in &dataset.views {
        let path = dir.join(&view.name);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(Error::io(parent))?;
        }
        match &view.photo {
            PhotoSource::Memory(photo) => save_photo(photo, &path)?,
            _ => return Err(Error::file(&path, "not in memory: only made data sets are saved")),
        }
    }
    let model = dir.join("sparse/0");
    std::fs::create_dir_all(&model).map_err(Error::io(&model))?;
    let write = |name: &str, bytes: Vec<u8>| {
        let path = model.join(name);
        std::fs::write(&path, bytes).map_err(Error::io(&path))
    };
    write("cameras.bin", cameras(dataset))?;
    write("images.bin", images(dataset))?;
    write("points3D.bin", points(dataset))?;
    if options.exposure_seed.is_some() {
        save_truth(dataset, options, dir)?;
    }
    Ok(())
}

fn save_truth(dataset: &Dataset, options: &SynthOptions, dir: &Path) -> Result<()> {
    let stops = dataset.views.iter().zip(options.exposures());
    let truth = json!({
        "perturbation": "exposure",
        "seed": options.exposure_seed,
        "stops": stops
            .map(|(view, stops)| (file_name(view).to_owned(), json!(stops)))
            .collect::<serde_json::Map<_, _>>(),
    });
    let path = dir.join("truth.json");
    std::fs::write(&path, format!("{truth:#}\n")).map_err(Error::io(&path))
}

/// Name below `images`.
fn file_name(view: &View) -> &str {
    view.name.trim_start_matches("images/")
}

/// PINHOLE, one for each view.
fn cameras(dataset: &Dataset) -> Vec<u8> {
    let mut bytes = (dataset.views.len() as u64).to_le_bytes().to_vec();
    for (id, View { camera, .. }) in dataset.views.iter().enumerate() {
        bytes.extend((id as u32 + 1).to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(
            [camera.width, camera.height]
                .map(u64::from)
                .map(u64::to_le_bytes)
                .as_flattened(),
        );
        let parameters = [camera.focal.x, camera.focal.y, camera.center.x, camera.center.y];
        bytes.extend(parameters.map(f64::to_le_bytes).as_flattened());
    }
    bytes
}

fn images(dataset: &Dataset) -> Vec<u8> {
    let mut bytes = (dataset.views.len() as u64).to_le_bytes().to_vec();
    for (id, view) in dataset.views.iter().enumerate() {
        let camera = &view.camera;
        bytes.extend((id as u32 + 1).to_le_bytes());
        let DQuat { x, y, z, w } = DQuat::from_mat3(&camera.rotation);
        let translation = -(camera.rotation * camera.position);
        let pose = [w, x, y, z, translation.x, translation.y, translation.z];
        bytes.extend(pose.map(f64::to_le_bytes).as_flattened());
        bytes.extend((id as u32 + 1).to_le_bytes());
        bytes.extend(file_name(view).as_bytes());
        bytes.push(0);
        let seen: &[u32] = dataset.tracks.get(id).map_or(&[], Vec::as_slice);
        bytes.extend((seen.len() as u64).to_le_bytes());
        for &point in seen {
            let place = camera.pixel_from_world(dataset.points[point as usize].position.into());
            bytes.extend(
                place
                    .unwrap_or_default()
                    .to_array()
                    .map(f64::to_le_bytes)
                    .as_flattened(),
            );
            bytes.extend((u64::from(point) + 1).to_le_bytes());
        }
    }
    bytes
}

fn points(dataset: &Dataset) -> Vec<u8> {
    let mut tracks: Vec<Vec<[u32; 2]>> = vec![Vec::new(); dataset.points.len()];
    for (view, seen) in dataset.tracks.iter().enumerate() {
        for (place, &point) in seen.iter().enumerate() {
            tracks[point as usize].push([view as u32 + 1, place as u32]);
        }
    }
    let mut bytes = (dataset.points.len() as u64).to_le_bytes().to_vec();
    for (id, (point, track)) in dataset.points.iter().zip(tracks).enumerate() {
        bytes.extend((id as u64 + 1).to_le_bytes());
        bytes.extend(point.position.map(f64::to_le_bytes).as_flattened());
        bytes.extend(point.color.map(Photo::level));
        bytes.extend(0_f64.to_le_bytes());
        bytes.extend((track.len() as u64).to_le_bytes());
        bytes.extend(track.as_flattened().iter().flat_map(|number| number.to_le_bytes()));
    }
    bytes
}
