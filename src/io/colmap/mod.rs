//! COLMAP reconstructions, binary and text: cameras, images, points.
//!
//! Of the 2D points, only the ids of their points are kept; references to missing points are dropped. Tracks are
//! skipped. Of the files `rigs` and `frames` of COLMAP 3.12 and later, the binary ones give poses where those of
//! `images` differ. Points are sorted by id, because the binary form has them in hash-table order.

mod binary;
mod camera;
mod rigs;
mod text;

use super::check::{Check, inside};
use super::listing::{ListedView, Listing, check_position};
use super::photo_index::mask_in;
use super::reader::excerpt;
use super::source::Source;
use crate::error::{Error, Result};
use crate::scene::{Camera, Point};
use camera::Intrinsics;
use glam::{DQuat, DVec3};
pub(super) use rigs::{RigidMotion, corrected};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The model's folder in a data set's folder: `sparse/0`, `sparse`, or itself.
pub fn find_model(folder: &Path) -> Option<PathBuf> {
    let candidates = ["sparse/0", "sparse", ""].map(|sub| folder.join(sub));
    candidates
        .into_iter()
        .find(|c| c.join("cameras.bin").is_file() || c.join("cameras.txt").is_file())
}

/// An entry of `images`.
struct ImageRecord {
    id: u32,
    name: String,
    /// `view_from_world` as w, x, y, z.
    quaternion: [f64; 4],
    translation: [f64; 3],
    camera: u32,
    /// Ids of the points seen.
    seen: Vec<u64>,
}

/// A point and its id.
type PointWithId = (u64, Point);

/// Files of a model, all in one form.
#[derive(Clone, Copy, Debug)]
pub struct Files<'a> {
    /// Binary form; else text.
    pub binary: bool,
    /// `cameras`.
    pub cameras: Source<'a>,
    /// `images`.
    pub images: Source<'a>,
    /// `points3D`, if it exists.
    pub points: Option<Source<'a>>,
    /// `rigs` and `frames` in the binary form, if they exist.
    pub rigs: Option<[Source<'a>; 2]>,
}

/// Reads the model in folder `model` with photographs in folder `photos`. If both forms exist, the binary files are
/// read, as in COLMAP.
///
/// # Errors
/// Those of [`read_files`], and a model without cameras or images.
pub fn read(model: &Path, photos: &Path) -> Result<Listing> {
    let binary = model.join("cameras.bin").is_file();
    let extension = if binary { "bin" } else { "txt" };
    let file = |stem: &str| model.join(format!("{stem}.{extension}"));
    let (cameras, images, points) = (file("cameras"), file("images"), file("points3D"));
    for needed in [&cameras, &images] {
        if !needed.is_file() {
            return Err(Error::file(needed, "is missing from the COLMAP model"));
        }
    }
    let has_points = points.is_file();
    let rigs = rig_files(model);
    let files = Files {
        rigs: rigs.as_ref().map(|files| files.each_ref().map(Source::from)),
        binary,
        cameras: Source::from(&cameras),
        images: Source::from(&images),
        points: has_points.then(|| Source::from(&points)),
    };
    let mut listing = read_files(&files, photos)?;
    if !has_points {
        let warning = format!("{}: is missing", points.display());
        listing.warnings.push(warning);
    }
    Ok(listing)
}

/// `rigs.bin` and `frames.bin` of a binary model, if both exist.
fn rig_files(model: &Path) -> Option<[PathBuf; 2]> {
    let files = ["rigs.bin", "frames.bin"].map(|name| model.join(name));
    let is_whole = model.join("cameras.bin").is_file() && files.iter().all(|file| file.is_file());
    is_whole.then_some(files)
}

/// Poses of images by id that follow from a model's rigs and frames; none without these files, or of damaged ones.
pub(super) fn poses_by_frames(model: &Path) -> BTreeMap<u64, RigidMotion> {
    let poses = rig_files(model).map(|[rigs, frames]| rigs::poses(Source::from(&rigs), Source::from(&frames)));
    poses.and_then(Result::ok).unwrap_or_default()
}

/// Gives images the poses of rigs and frames where theirs differ. Returns the warnings.
fn correct_poses(images: &mut [ImageRecord], files: &Files<'_>) -> Vec<String> {
    let Some([rigs, frames]) = files.rigs else {
        return Vec::new();
    };
    let poses = match rigs::poses(rigs, frames) {
        Ok(poses) => poses,
        Err(error) => return vec![format!("{error}; poses are those of the images alone")],
    };
    let all = images.len();
    let mut differing = Vec::new();
    for image in images {
        let [w, x, y, z] = image.quaternion;
        let [a, b, c] = image.translation;
        let pose = poses.get(&image.id.into());
        if let Some([w, x, y, z, a, b, c]) = pose.and_then(|pose| corrected([w, x, y, z, a, b, c], pose)) {
            image.quaternion = [w, x, y, z];
            image.translation = [a, b, c];
            differing.push(image.name.as_str());
        }
    }
    let warning = |first: &&str| {
        format!(
            "{}: {} of {all} poses differ from those of rigs and frames, which are used (the first is of {})",
            files.images.name().display(),
            differing.len(),
            excerpt(first)
        )
    };
    differing.first().map(warning).into_iter().collect()
}

/// Reads a model with photographs in folder `photos`.
///
/// # Errors
/// Names the file and the byte or line: truncation, counts beyond the file, an unsupported camera model, invalid camera
/// values, names that lead out of `photos`.
pub fn read_files(files: &Files<'_>, photos: &Path) -> Result<Listing> {
    let lenses = if files.binary {
        binary::cameras(files.cameras)?
    } else {
        text::cameras(files.cameras)?
    };
    let mut images = if files.binary {
        binary::images(files.images)?
    } else {
        text::images(files.images)?
    };
    if images.is_empty() {
        return Err(Error::file(files.images.name(), "holds no images"));
    }
    let warnings = correct_poses(&mut images, files);
    let mut points = match files.points {
        Some(points) if files.binary => binary::points(points)?,
        Some(points) => text::points(points)?,
        None => Vec::new(),
    };
    points.sort_by_key(|(id, _)| *id);
    let ids: Vec<u64> = points.iter().map(|(id, _)| *id).collect();
    let views = images
        .into_iter()
        .map(|image| {
            let name = image.name.clone();
            listed(image, &ids, &lenses, files, photos).map_err(|what| {
                let what = format!("image {}: {what}", excerpt(&name));
                Error::file(files.images.name(), what)
            })
        })
        .collect::<Result<_>>()?;
    Ok(Listing {
        views,
        points: points.into_iter().map(|(_, point)| point).collect(),
        warnings,
    })
}

/// Indices of the points with these ids among the sorted ids of all, ascending, each once.
fn indices(seen: &[u64], ids: &[u64]) -> Vec<u32> {
    let place = |id: &u64| ids.binary_search(id).ok().and_then(|index| u32::try_from(index).ok());
    let mut found: Vec<u32> = seen.iter().filter_map(place).collect();
    found.sort_unstable();
    found.dedup();
    found
}

fn listed(
    image: ImageRecord,
    ids: &[u64],
    lenses: &BTreeMap<u32, Intrinsics>,
    files: &Files<'_>,
    photos: &Path,
) -> Check<ListedView> {
    let photo = inside(photos, &image.name)?;
    let lens = lenses.get(&image.camera).ok_or_else(|| {
        let cameras = files.cameras.name().file_name().unwrap_or_default();
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
    let position = -(rotation.transpose() * translation);
    check_position(position)?;
    let name = image.name;
    Ok(ListedView {
        name: name.clone(),
        photo,
        camera: Camera {
            width: lens.width,
            height: lens.height,
            focal: lens.focal,
            center: lens.center,
            rotation,
            position,
        },
        lens: lens.lens,
        mask: mask_in(&photos.parent().unwrap_or(Path::new(".")).join("masks"), &name),
        held_out: false,
        seen: indices(&image.seen, ids),
    })
}
