//! `transforms.json` of nerfstudio and instant-ngp, and Blender's `transforms_train.json`.
//!
//! Intrinsics may stand at the root or in a frame; the frame's take precedence. `transform_matrix` is camera to world
//! with y up and z backward. `applied_transform` is not applied: nerfstudio has already applied it to the matrices
//! *and* to the points of `ply_file_path`, so both are in one world.

mod lens;
mod pose;
mod scope;

use super::check::{Check, inside};
use super::json::{self, object, whole};
use super::listing::{ListedView, Listing, check_position, check_size};
use super::reader::Reader;
use super::source::Source;
use super::{photo, ply};
use crate::error::{Error, Result};
use crate::scene::Camera;
use glam::DVec2;
use scope::Scope;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Extensions tried if a `file_path` names no file, as Blender leaves them out.
const EXTENSIONS: [&str; 9] = ["png", "jpg", "jpeg", "PNG", "JPG", "JPEG", "webp", "tif", "tiff"];

/// The file in a data set's folder, if it exists: `transforms.json`, else `transforms_train.json`.
pub fn find(folder: &Path) -> Option<PathBuf> {
    ["transforms.json", "transforms_train.json"]
        .map(|name| folder.join(name))
        .into_iter()
        .find(|path| path.is_file())
}

/// Reads one file. Photographs are beside it, or below `photos` if given.
///
/// # Errors
/// Names the file and the frame (counted from 0): not JSON, missing keys or keys of the wrong type, a matrix that is
/// not a pose, an unknown camera model, an image size given by neither file nor photograph, names that lead
/// out of the folder.
pub fn read<'a>(source: impl Into<Source<'a>>, photos: Option<&Path>) -> Result<Listing> {
    let source = source.into();
    let path = source.name();
    let folder = path.parent().unwrap_or(Path::new("."));
    let bytes = Reader::all(source)?;
    let root = json::parse(path, &bytes)?;
    let fault = |what: String| Error::file(path, what);
    let root = object(&root).map_err(|what| fault(format!("the top level {what}")))?;
    let frames = match root.get("frames") {
        Some(Value::Array(frames)) if frames.is_empty() => Err("\"frames\" is empty"),
        Some(Value::Array(frames)) => Ok(frames),
        Some(_) => Err("\"frames\" is not a list"),
        None => Err("has no \"frames\""),
    };
    let frames = frames.map_err(|what| fault(what.to_owned()))?;
    let mut listing = Listing::default();
    let mut scaled = Vec::new();
    for (index, frame) in frames.iter().enumerate() {
        let view = object(frame)
            .and_then(|frame| {
                let scope = Scope { frame, root };
                read_frame(&scope, photos.unwrap_or(folder))
            })
            .map_err(|what| fault(format!("frame {index}: {what}")))?;
        if view.1 {
            scaled.push(index);
        }
        listing.views.push(view.0);
    }
    if let Some(first) = scaled.first() {
        listing.warnings.push(format!(
            "{}: {} rotations are scaled and were normalised (the first in frame {first})",
            path.display(),
            scaled.len()
        ));
    }
    read_points(path, folder, root, &mut listing)?;
    Ok(listing)
}

/// A view, and true if its matrix was scaled.
fn read_frame(scope: &Scope<'_>, folder: &Path) -> Check<(ListedView, bool)> {
    let name = scope.text("file_path")?.ok_or("has no \"file_path\"")?;
    // Windows programs write backslashes.
    let name = name.replace('\\', "/");
    let name = name.trim_start_matches("./");
    let photo = with_extension(inside(folder, name)?);
    let matrix = scope.frame.get("transform_matrix");
    let pose = pose::read(matrix.ok_or("has no \"transform_matrix\"")?)?;
    check_position(pose.position)?;
    let (width, height) = match (scope.number("w")?, scope.number("h")?) {
        (Some(w), Some(h)) => check_size(whole(w)?, whole(h)?)?,
        _ if photo.is_file() => photo::dimensions(&photo).map_err(|e| e.to_string())?,
        _ => {
            return Err(format!(
                "no \"w\" and \"h\", and no photograph {} to take them from",
                photo.display()
            ));
        }
    };
    let (focal, center, lens) = lens::read(scope, width, height)?;
    let mask = scope.text_of_frame("mask_path")?;
    let mask = mask.map(|name| inside(folder, name.replace('\\', "/").trim_start_matches("./")));
    let view = ListedView {
        name: name.to_owned(),
        photo,
        camera: Camera {
            width,
            height,
            focal: DVec2::from(focal),
            center: DVec2::from(center),
            rotation: pose.rotation,
            position: pose.position,
        },
        lens: Some(lens.simplified()).filter(|lens| !lens.is_none()),
        mask: mask.transpose()?,
        held_out: false,
        seen: Vec::new(),
    };
    Ok((view, pose.was_scaled))
}

fn with_extension(path: PathBuf) -> PathBuf {
    if path.is_file() {
        return path;
    }
    let tried = EXTENSIONS.map(|extension| {
        // Appended, not replaced: names such as `frame.0001` have dots of their own.
        let mut name = path.clone().into_os_string();
        name.push(".");
        name.push(extension);
        PathBuf::from(name)
    });
    tried.into_iter().find(|p| p.is_file()).unwrap_or(path)
}

fn read_points(path: &Path, folder: &Path, root: &Map<String, Value>, listing: &mut Listing) -> Result<()> {
    let Some(name) = json::text(root, "ply_file_path").map_err(|what| Error::file(path, what))? else {
        return Ok(());
    };
    let name = name.replace('\\', "/");
    let cloud = inside(folder, &name).map_err(|what| Error::file(path, what))?;
    if cloud.is_file() {
        listing.points = ply::read_points(&cloud)?;
    } else {
        let cloud = cloud.display();
        listing.warnings.push(format!("{cloud}: the point cloud is missing"));
    }
    Ok(())
}
