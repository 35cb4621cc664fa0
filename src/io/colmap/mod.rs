//! COLMAP reconstructions, binary and text: cameras, images, points.
//!
//! Tracks and 2D points are skipped, so references in them can be broken without harm; so are the files
//! `rigs` and `frames` of COLMAP 3.12 and later, as `images` still has every pose. Points are put in the
//! order of their ids: the binary form has them in that of a hash table.

mod binary;
mod camera;
mod text;

use super::listing::{Check, Listed, Listing, inside};
use super::reader::excerpt;
use crate::error::{Error, Result};
use crate::scene::{Camera, Point};
use camera::Lens;
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The folder of the model that belongs to a data set's folder: `sparse/0`, `sparse`, or itself.
pub fn find_model(folder: &Path) -> Option<PathBuf> {
    let candidates = ["sparse/0", "sparse", ""].map(|sub| folder.join(sub));
    candidates
        .into_iter()
        .find(|c| c.join("cameras.bin").is_file() || c.join("cameras.txt").is_file())
}

/// An entry of `images`.
struct ImageRecord {
    name: String,
    /// `view_from_world` as w, x, y, z.
    quaternion: [f64; 4],
    translation: [f64; 3],
    camera: u32,
}

/// A point and its id.
type Numbered = (u64, Point);

/// The three files of a model.
struct Files {
    binary: bool,
    cameras: PathBuf,
    images: PathBuf,
    points: PathBuf,
}

impl Files {
    /// The binary files are taken where both forms are there, as COLMAP does.
    fn find(model: &Path) -> Result<Files> {
        let binary = model.join("cameras.bin").is_file();
        let extension = if binary { "bin" } else { "txt" };
        let file = |stem: &str| model.join(format!("{stem}.{extension}"));
        let files = Files {
            binary,
            cameras: file("cameras"),
            images: file("images"),
            points: file("points3D"),
        };
        for needed in [&files.cameras, &files.images] {
            if !needed.is_file() {
                return Err(Error::file(needed, "is missing from the COLMAP model"));
            }
        }
        Ok(files)
    }
}

/// Reads the model in folder `model`, whose photographs are in folder `photos`.
///
/// # Errors
/// Names the file and the byte or line: cut short, counts beyond the file, a camera model that is not
/// supported, values no camera has, names that lead out of `photos`.
pub fn read(model: &Path, photos: &Path) -> Result<Listing> {
    let files = Files::find(model)?;
    let mut warnings = Vec::new();
    let lenses = if files.binary {
        binary::cameras(&files.cameras)?
    } else {
        text::cameras(&files.cameras)?
    };
    let images = if files.binary {
        binary::images(&files.images)?
    } else {
        text::images(&files.images)?
    };
    if images.is_empty() {
        return Err(Error::file(&files.images, "holds no images"));
    }
    let mut points = Vec::new();
    if files.points.is_file() {
        points = if files.binary {
            binary::points(&files.points)?
        } else {
            text::points(&files.points)?
        };
    } else {
        warnings.push(format!("{}: is missing", files.points.display()));
    }
    points.sort_by_key(|(id, _)| *id);
    let views = images
        .into_iter()
        .map(|image| {
            let name = image.name.clone();
            listed(image, &lenses, &files, photos).map_err(|what| {
                Error::file(&files.images, format!("image {}: {what}", excerpt(&name)))
            })
        })
        .collect::<Result<_>>()?;
    Ok(Listing {
        views,
        points: points.into_iter().map(|(_, point)| point).collect(),
        warnings,
    })
}

fn listed(
    image: ImageRecord,
    lenses: &BTreeMap<u32, Lens>,
    files: &Files,
    photos: &Path,
) -> Check<Listed> {
    let photo = inside(photos, &image.name)?;
    let lens = lenses.get(&image.camera).ok_or_else(|| {
        let cameras = files.cameras.file_name().unwrap_or_default();
        let known = lenses.len();
        format!(
            "refers to camera {}, which is not among the {known} of {}",
            image.camera,
            cameras.to_string_lossy()
        )
    })?;
    let [w, x, y, z] = image.quaternion;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let length = quaternion.length();
    if !(length.is_finite() && length > 1e-9) {
        return Err(format!("the rotation {w} {x} {y} {z} is no quaternion"));
    }
    let translation = DVec3::from(image.translation);
    if !translation.is_finite() {
        return Err(format!("the translation {translation} is not finite"));
    }
    let rotation = glam::DMat3::from_quat(quaternion / length);
    Ok(Listed {
        name: image.name,
        photo,
        camera: Camera {
            width: lens.width,
            height: lens.height,
            focal: lens.focal,
            center: lens.center,
            rotation,
            position: -(rotation.transpose() * translation),
        },
        distortion: lens.distortion,
        held_out: false,
    })
}
