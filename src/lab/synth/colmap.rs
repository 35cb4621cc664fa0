//! COLMAP's binary model of a made data set, with the tracks of its points, and the truth of its perturbations.

use super::fisheye::FisheyeLens;
use super::perturb::VIGNETTING_STOPS;
use super::save::save_photo;
use super::{Scene, SynthOptions};
use crate::error::{Error, Result};
use crate::scene::{Dataset, Photo, PhotoSource, View};
use glam::DQuat;
use serde_json::json;
use std::path::Path;

/// Writes `dataset`, with photographs in memory, to the folder `dir`: `images/NAME.png`, the model in `sparse/0`. Every
/// camera has an entry of its own; 2D points are exact projections. With perturbations, `truth.json` has the stops of
/// each photograph's red, green and blue, and the folders of the exact model and of [`save_masks`]. Existing files are
/// replaced.
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
    save_model(dataset, options, &dir.join("sparse/0"))?;
    save_truth(dataset, options, dir)
}

/// Writes the model alone to a folder, which is created.
pub fn save_model(dataset: &Dataset, options: &SynthOptions, model: &Path) -> Result<()> {
    std::fs::create_dir_all(model).map_err(Error::io(model))?;
    let write = |name: &str, bytes: Vec<u8>| {
        let path = model.join(name);
        std::fs::write(&path, bytes).map_err(Error::io(&path))
    };
    write("cameras.bin", cameras(dataset, options))?;
    write("images.bin", images(dataset))?;
    write("points3D.bin", points(dataset))
}

fn save_truth(dataset: &Dataset, options: &SynthOptions, dir: &Path) -> Result<()> {
    let mut truth = serde_json::Map::new();
    if let Some(seed) = options.exposure_seed {
        let stops = dataset.views.iter().zip(options.exposures());
        let stops = stops.map(|(view, stops)| (file_name(view).to_owned(), json!(stops)));
        truth.insert("seed".into(), json!(seed));
        truth.insert("stops".into(), stops.collect::<serde_json::Map<_, _>>().into());
    }
    if options.vignetting {
        truth.insert("vignetting_stops".into(), json!(VIGNETTING_STOPS));
    }
    if let Some(seed) = options.pose_seed {
        truth.insert("seed".into(), json!(seed));
        truth.insert("poses".into(), json!("truth"));
    }
    if let Some(seed) = options.transient_seed {
        truth.insert("seed".into(), json!(seed));
        truth.insert("masks".into(), json!("truth/masks"));
    }
    if truth.is_empty() {
        return Ok(());
    }
    let path = dir.join("truth.json");
    std::fs::write(&path, format!("{:#}\n", json!(truth))).map_err(Error::io(&path))
}

/// Writes `NAME.png` for each view with a passer-by to a folder, which is created: black where it hides the scene.
pub fn save_masks(scene: &Scene, dataset: &Dataset, options: &SynthOptions, masks: &Path) -> Result<()> {
    std::fs::create_dir_all(masks).map_err(Error::io(masks))?;
    for view in options.occluded() {
        let covered = scene.passerby_pixels(options, view);
        let level = |&is_covered: &bool| if is_covered { [0, 0, 0, 255] } else { [255; 4] };
        let photo = Photo {
            width: options.width,
            height: options.height,
            rgba: covered.iter().map(level).collect(),
        };
        save_photo(&photo, &masks.join(file_name(&dataset.views[view])))?;
    }
    Ok(())
}

/// Name below `images`.
fn file_name(view: &View) -> &str {
    view.name.trim_start_matches("images/")
}

/// PINHOLE or OPENCV_FISHEYE, one for each view.
fn cameras(dataset: &Dataset, options: &SynthOptions) -> Vec<u8> {
    let lens = FisheyeLens::of(options.width * options.height);
    let mut bytes = (dataset.views.len() as u64).to_le_bytes().to_vec();
    for (id, View { camera, .. }) in dataset.views.iter().enumerate() {
        bytes.extend((id as u32 + 1).to_le_bytes());
        let mut put = |model: u32, size: [u32; 2], parameters: &[f64]| {
            bytes.extend(model.to_le_bytes());
            bytes.extend(size.map(u64::from).map(u64::to_le_bytes).as_flattened());
            bytes.extend(parameters.iter().flat_map(|parameter| parameter.to_le_bytes()));
        };
        if options.is_fisheye(id) {
            let (focal, middle) = (lens.focal, 0.5 * f64::from(lens.side));
            let parameters = [&[focal, focal, middle, middle][..], &lens.radial].concat();
            put(5, [lens.side; 2], &parameters);
        } else {
            let parameters = [camera.focal.x, camera.focal.y, camera.center.x, camera.center.y];
            put(1, [camera.width, camera.height], &parameters);
        }
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
