//! Cameras of the pictures: views of a data set, a path, or an orbit.

use super::{RenderArgs, orbit, orbit_of_cameras};
use crate::cli::output::file_stem;
use crate::io::camera_path::{self, PathOptions};
use crate::io::dataset::Reconstruction;
use crate::scene::{Camera, Dataset, Similarity, Splats, cameras_between};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Pictures in order.
pub(super) struct Sequence {
    /// Stem of the file name and camera of each.
    pub(super) pictures: Vec<(String, Camera)>,
    /// Frames a second, if known.
    pub(super) rate: Option<f64>,
}

impl Sequence {
    pub(super) fn of(args: &RenderArgs, dataset: Option<&Dataset>, splats: &Splats) -> Result<Sequence> {
        let sequence = match &args.path {
            Some(path) => on_path(args, path, splats)?,
            None => Sequence {
                pictures: around_or_views(args, dataset, splats)?,
                rate: None,
            },
        };
        Ok(match args.size {
            Some([width, height]) => sequence.with_size(width, height),
            None => sequence,
        })
    }

    /// The same cameras at another image size.
    pub(super) fn with_size(self, width: u32, height: u32) -> Sequence {
        let resized = |(stem, camera): (String, Camera)| (stem, camera.with_size(width, height));
        Sequence {
            pictures: self.pictures.into_iter().map(resized).collect(),
            ..self
        }
    }
}

/// Pictures with numbers of at least four digits.
fn numbered(name: &str, cameras: Vec<Camera>) -> Vec<(String, Camera)> {
    let digits = cameras.len().saturating_sub(1).to_string().len().max(4);
    let named = |(i, camera)| (format!("{name}_{i:0digits$}"), camera);
    cameras.into_iter().enumerate().map(named).collect()
}

fn around_or_views(args: &RenderArgs, dataset: Option<&Dataset>, splats: &Splats) -> Result<Vec<(String, Camera)>> {
    let Some(dataset) = dataset else {
        return Ok(numbered("orbit", orbit::orbit_of_splats(splats, args.orbit)));
    };
    let views = dataset.split(args.split.into());
    if views.is_empty() {
        let path = args.cameras.as_deref().unwrap_or(Path::new("."));
        return Err(Error::file(path, "no view belongs to that split"));
    }
    let cameras: Vec<Camera> = views.iter().map(|&i| dataset.views[i].camera).collect();
    if let Some(count) = args.orbit {
        return Ok(numbered("orbit", orbit_of_cameras(&cameras, dataset.extent(), count)));
    }
    let stems = views.iter().map(|&i| file_stem(&dataset.views[i].name));
    Ok(stems.zip(cameras).collect())
}

fn on_path(args: &RenderArgs, path: &Path, splats: &Splats) -> Result<Sequence> {
    let options = PathOptions {
        size: args.size,
        axes: args.path_axes,
        rate: args.fps,
        world: world(args, path)?,
    };
    let read = camera_path::open(path, &options)?;
    for warning in &read.warnings {
        eprintln!("warning: {warning}");
    }
    let mut keys = read.cameras;
    for camera in &mut keys {
        camera.position -= splats.origin;
    }
    let cameras = match args.between {
        None => keys,
        Some(between) => {
            let (width, height) = keys.first().map_or((1, 1), |first| (first.width, first.height));
            let keys: Vec<Camera> = keys.iter().map(|key| key.with_size(width, height)).collect();
            cameras_between(&keys, between, args.closed || read.is_closed)
        }
    };
    Ok(Sequence {
        pictures: numbered("path", cameras),
        rate: read.rate,
    })
}

/// Map from nerfstudio's normalised world to the scene's, if the file that tells it is beside the path.
fn world(args: &RenderArgs, path: &Path) -> Result<Option<Similarity>> {
    let Some(file) = camera_path::dataparser(path) else {
        return Ok(None);
    };
    let world = camera_path::normalised_world(&file)?;
    Ok(Some(match args.cameras.as_deref().and_then(transforms_of) {
        Some(transforms) => camera_path::applied_transform(&transforms)?.after(&world),
        None => world,
    }))
}

/// The `transforms.json` of a data set, if its cameras are from there.
fn transforms_of(data: &Path) -> Option<PathBuf> {
    match Reconstruction::find(data) {
        Ok(Some(Reconstruction::Transforms(file))) => Some(file),
        _ => None,
    }
}
