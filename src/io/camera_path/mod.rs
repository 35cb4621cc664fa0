//! Camera paths: cameras in order, for pictures without photographs.
//!
//! | file | world | cameras |
//! |---|---|---|
//! | nerfstudio's `camera_path.json` | a normalised one; `dataparser_transforms.json` leads back | `camera_path` |
//! | `cameras.json` of the 3DGS code | the scene's | in file order |
//! | `transforms.json` | the scene's | in file order |
//! | COLMAP model, without photographs or points | the scene's | by name |
//! | `.gltf`, `.glb` | glTF's axes | nodes with a perspective camera in node order, or the first animated one |
//!
//! Lenses are left out, with a warning: pictures are those of a pinhole with the same focal lengths.

mod inria;
mod nerfstudio;

use super::json::{self, object};
use super::listing::{ListedView, Listing, check_intrinsics, check_position, check_size};
use super::pose::Pose;
use super::reader::Reader;
use super::source::Source;
use super::{colmap, gltf, transforms};
use crate::error::{Error, Result};
use crate::scene::{Axes, Camera, Similarity};
use glam::DVec2;
pub use nerfstudio::{applied_transform, normalised_world};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Size of pictures where a file states none, pixels.
const SIZE: [u32; 2] = [1280, 720];

/// Frames a second at which animations are sampled where nothing else is asked for.
const RATE: f64 = 30.0;

/// Cameras in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraPath {
    /// At least one.
    pub cameras: Vec<Camera>,
    /// Frames a second, if the file states them.
    pub rate: Option<f64>,
    /// Whether the file has the path return to its first camera.
    pub is_closed: bool,
    /// Omissions, one sentence each.
    pub warnings: Vec<String>,
}

/// Options for reading a path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PathOptions {
    /// Width and height of the pictures; the vertical field of view stays. `None`: as the file has it.
    pub size: Option<[u32; 2]>,
    /// Axes of the path's world; `None`: glTF's for glTF files, the engine's for others.
    pub axes: Option<Axes>,
    /// Frames a second at which an animation is sampled; `None`: 30.
    pub rate: Option<f64>,
    /// Map from nerfstudio's normalised world to the scene's; `None`: the scene is in the normalised one.
    pub world: Option<Similarity>,
}

/// Name of the file beside a `camera_path.json` that leads to the world of the data set.
pub const DATAPARSER: &str = "dataparser_transforms.json";

/// Reads the path of a file, or of a folder with a COLMAP model or a `transforms.json`.
///
/// # Errors
/// Those of [`read`], and a folder without either.
pub fn open(path: &Path, options: &PathOptions) -> Result<CameraPath> {
    let meta = std::fs::metadata(path).map_err(Error::io(path))?;
    let is_part = |name: &str| path.file_stem().is_some_and(|stem| stem == name);
    let is_of_colmap = path.extension().is_some_and(|e| e == "bin" || e == "txt");
    if meta.is_file() && is_of_colmap && (is_part("images") || is_part("cameras")) {
        return open_model(path.parent().unwrap_or(Path::new("")), options);
    }
    if meta.is_file() {
        return read(path, options);
    }
    if let Some(model) = colmap::find_model(path) {
        return open_model(&model, options);
    }
    match transforms::find(path) {
        Some(file) => read(&file, options),
        None => {
            let what = "is no camera path: a folder needs a COLMAP model or a transforms.json";
            Err(Error::file(path, what))
        }
    }
}

/// The file of a `dataparser_transforms.json` beside a path, if it exists.
pub fn dataparser(path: &Path) -> Option<PathBuf> {
    Some(path.with_file_name(DATAPARSER)).filter(|file| file.is_file())
}

fn open_model(model: &Path, options: &PathOptions) -> Result<CameraPath> {
    let mut listing = colmap::read(model, Path::new("images"))?;
    // Points are not needed.
    listing.warnings.clear();
    listing.views.sort_by(|a, b| a.name.cmp(&b.name));
    finished(model, of_listing(model, listing), options, Axes::RDF)
}

/// Reads a JSON or glTF file; the kind is told by the contents.
///
/// # Errors
/// Names the file and the camera: neither JSON nor glTF, another document, no cameras, missing keys or keys of the
/// wrong type, matrices that are no poses, camera models other than perspective, impossible sizes and fields of view.
pub fn read<'a>(source: impl Into<Source<'a>>, options: &PathOptions) -> Result<CameraPath> {
    let source = source.into();
    let path = source.name();
    let bytes = Reader::all(source)?;
    let fault = |what: String| Error::file(path, what);
    if gltf::is_binary(&bytes) {
        return of_gltf(source, &bytes, options);
    }
    let root = json::parse(path, &bytes)?;
    let read = match &root {
        Value::Array(list) => inria::read(list).map_err(fault)?,
        Value::Object(root) if root.contains_key("camera_path") => {
            nerfstudio::read(path, root, options.world.as_ref()).map_err(fault)?
        }
        Value::Object(root) if root.contains_key("frames") => of_listing(path, transforms::read(source, None)?),
        Value::Object(root) if root.contains_key("asset") => return of_gltf(source, &bytes, options),
        other => {
            object(other).map_err(|what| fault(format!("the top level {what}")))?;
            let what = "is no camera path: a list of cameras (cameras.json of the 3DGS code), \"camera_path\" \
                        (nerfstudio), \"frames\" (transforms.json) or \"asset\" (glTF) is expected";
            return Err(fault(what.into()));
        }
    };
    finished(path, read, options, Axes::RDF)
}

/// Pinhole cameras of a reconstruction.
fn of_listing(path: &Path, listing: Listing) -> CameraPath {
    let mut warnings = listing.warnings;
    let bent = listing.views.iter().filter(|view| view.lens.is_some()).count();
    if bent > 0 {
        let all = listing.views.len();
        let what = "have a lens; their pictures are those of a pinhole";
        warnings.push(format!("{}: {bent} of {all} cameras {what}", path.display()));
    }
    let camera = |view: &ListedView| view.camera;
    CameraPath {
        cameras: listing.views.iter().map(camera).collect(),
        warnings,
        ..CameraPath::default()
    }
}

fn of_gltf(source: Source<'_>, bytes: &[u8], options: &PathOptions) -> Result<CameraPath> {
    let path = source.name();
    let folder = match source.in_memory() {
        Some(_) => None,
        None => Some(path.parent().unwrap_or(Path::new(""))),
    };
    let rate = options.rate.unwrap_or(RATE);
    let found = gltf::cameras(bytes, folder, rate).map_err(|what| Error::file(path, what))?;
    let mut result = CameraPath {
        rate: found.is_animated.then_some(rate),
        warnings: found
            .warnings
            .iter()
            .map(|what| format!("{}: {what}", path.display()))
            .collect(),
        ..CameraPath::default()
    };
    for camera in &found.cameras {
        let fault = |what| Error::file(path, format!("the camera of node {}: {what}", camera.node));
        let pose = Pose::of_opengl(camera.linear, camera.translation, "its node").map_err(fault)?;
        let height = SIZE[1];
        let width = camera
            .aspect
            .map_or(f64::from(SIZE[0]), |aspect| (aspect * f64::from(height)).round());
        // The cast saturates, and the check refuses the result.
        let (width, height) = check_size(width as u64, height.into()).map_err(fault)?;
        let focal = 0.5 * f64::from(height) / (0.5 * camera.yfov).tan();
        result
            .cameras
            .push(pinhole([width, height], [focal; 2], &pose).map_err(fault)?);
    }
    finished(path, result, options, Axes::LUF)
}

/// A checked camera with its principal point in the middle.
fn pinhole([width, height]: [u32; 2], focal: [f64; 2], pose: &Pose) -> super::check::Check<Camera> {
    let center = [f64::from(width) / 2.0, f64::from(height) / 2.0];
    check_intrinsics(focal, center)?;
    check_position(pose.position)?;
    Ok(Camera {
        width,
        height,
        focal: DVec2::from(focal),
        center: DVec2::from(center),
        rotation: pose.rotation,
        position: pose.position,
    })
}

/// Turns the cameras to the engine's axes, and gives them the wanted size.
fn finished(path: &Path, mut read: CameraPath, options: &PathOptions, usual: Axes) -> Result<CameraPath> {
    let axes = options.axes.unwrap_or(usual);
    let matrix = axes.to(Axes::RDF);
    if matrix.determinant() < 0.0 {
        let what = format!("the axes {axes} mirror the world, in which no camera has a place");
        return Err(Error::file(path, what));
    }
    for camera in &mut read.cameras {
        camera.position = matrix * camera.position;
        camera.rotation *= matrix.transpose();
        if let Some([width, height]) = options.size {
            *camera = camera.with_size(width, height);
        }
        check_position(camera.position).map_err(|what| Error::file(path, what))?;
    }
    Ok(read)
}
