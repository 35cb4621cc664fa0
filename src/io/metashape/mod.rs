//! Metashape's list of cameras, "Agisoft XML": `<document>` with one `<chunk>` of sensors and cameras.
//!
//! `<transform>` of a camera is its pose in the chunk, rows of a matrix from the camera (x right, y down, z forward).
//! The world is that of the transform of the camera's component, in files without it that of the chunk's, else the
//! chunk itself. Cameras that are switched off are left out, and, with a warning, those without a pose. The world of a
//! georeferenced chunk is geocentric.

mod motion;
mod sensor;
mod world;

use super::check::{Check, inside};
use super::listing::{ListedView, Listing, check_position};
use super::photo_index::{PhotoIndex, file_name, mask_in, masks_of, only_file, photos_beside, points_beside};
use super::pose::Pose;
use super::reader::{Reader, excerpt};
use super::source::Source;
use super::xml;
use crate::error::{Error, Result};
use crate::scene::{Camera, Similarity};
use glam::{DMat3, DVec3};
pub(super) use motion::moved;
use roxmltree::{Document, Node};
use sensor::SensorModel;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The list in a data set's folder, if there is one.
///
/// # Errors
/// Several lists.
pub fn find(folder: &Path) -> Result<Option<PathBuf>> {
    only_file(folder, "xml", |text| text.contains("<document"))
}

/// Reads a list. Photographs are below `photos` if given, else in `images` beside the file or beside it themselves;
/// points are those of NAME.ply or `points.ply` beside it.
///
/// # Errors
/// Names the file and the camera or sensor: not XML, no chunk or several, a sensor that is missing, without
/// calibration, of an unsupported type or with an impossible one, a pose of another count of numbers or no rotation,
/// numbers that are not finite, a scale that is not positive, a label that occurs twice or fits several photographs.
pub fn read<'a>(source: impl Into<Source<'a>>, photos: Option<&Path>) -> Result<Listing> {
    let source = source.into();
    let path = source.name();
    let bytes = Reader::all(source)?;
    let document = xml::parse(path, &bytes)?;
    let (folder, index) = photos_beside(path, photos);
    let place = PhotoFolder {
        masks: masks_of(path, &folder),
        folder,
        index,
    };
    let mut listing = read_chunk(&document, &place).map_err(|what| Error::file(path, what))?;
    for warning in &mut listing.warnings {
        *warning = format!("{}: {warning}", path.display());
    }
    listing.points = points_beside(path)?;
    Ok(listing)
}

/// Photographs and their masks.
struct PhotoFolder {
    folder: PathBuf,
    masks: PathBuf,
    index: PhotoIndex,
}

fn chunk_of<'a, 'i>(document: &'a Document<'i>) -> Check<Node<'a, 'i>> {
    let root = document.root_element();
    if !root.has_tag_name("document") {
        let name = excerpt(root.tag_name().name());
        return Err(format!(
            "is no list of Metashape's cameras: its root is {name}, not \"document\""
        ));
    }
    let mut chunks = root.children().filter(|child| child.has_tag_name("chunk"));
    match (chunks.next(), chunks.count()) {
        (None, _) => Err("has no <chunk>".to_owned()),
        (Some(chunk), 0) => Ok(chunk),
        (Some(_), more) => Err(format!("has {} chunks: export the cameras of one", more + 1)),
    }
}

fn read_chunk(document: &Document<'_>, place: &PhotoFolder) -> Check<Listing> {
    let chunk = chunk_of(document)?;
    let sensors = sensor::read_all(chunk)?;
    let worlds = world::Worlds::read(chunk)?;
    let (mut listing, mut names, mut components) = (Listing::default(), BTreeSet::new(), BTreeSet::new());
    let (mut without_pose, mut scaled) = (Vec::new(), Vec::new());
    for camera in cameras(chunk) {
        let label = camera.attribute("label").unwrap_or_default();
        let fault = |what: String| format!("camera {}: {what}", excerpt(label));
        // Control characters and empty labels are refused.
        let file = inside(&place.folder, file_name(label)).map_err(fault)?;
        let Some(matrix) = matrix_of(camera) else {
            without_pose.push(label);
            continue;
        };
        let photo = place.index.find(label).map_err(fault)?;
        let name = photo.unwrap_or_else(|| file_name(label)).to_owned();
        if !names.insert(name.clone()) {
            return Err(fault("occurs twice".to_owned()));
        }
        let model = model_of(camera, &sensors).map_err(fault)?;
        let pose = pose_of(matrix).map_err(fault)?;
        scaled.extend(pose.was_scaled.then_some(label));
        let component = camera.attribute("component_id");
        components.insert(component);
        let world = worlds.of(component).map_err(fault)?;
        let Pose { rotation, position, .. } = in_world(&pose, &world).map_err(fault)?;
        listing.views.push(ListedView {
            photo: photo.map_or(file, |photo| place.folder.join(photo)),
            mask: mask_in(&place.masks, &name),
            name,
            camera: Camera {
                rotation,
                position,
                ..model.camera
            },
            lens: model.lens,
            held_out: false,
            seen: Vec::new(),
        });
    }
    if listing.views.is_empty() {
        return Err(format!("has no camera with a pose ({} have none)", without_pose.len()));
    }
    let all = listing.views.len() + without_pose.len();
    let list = |names: &[&str], what: &str| {
        names.first().map(|first| {
            format!(
                "{} of {all} cameras {what} (the first is {})",
                names.len(),
                excerpt(first)
            )
        })
    };
    listing
        .warnings
        .extend(list(&without_pose, "have no pose and are left out"));
    listing
        .warnings
        .extend(list(&scaled, "have scaled rotations, which were normalised"));
    if components.len() > 1 {
        let what = "the cameras belong to components that were aligned apart";
        listing.warnings.push(format!("{what} ({} of them)", components.len()));
    }
    Ok(listing)
}

/// Cameras that are switched on, of all groups.
fn cameras<'a, 'i>(chunk: Node<'a, 'i>) -> impl Iterator<Item = Node<'a, 'i>> {
    let list = xml::child(chunk, "cameras");
    let all = list.into_iter().flat_map(|list| list.descendants());
    let is_on = |node: &Node<'_, '_>| !matches!(node.attribute("enabled"), Some("false" | "0"));
    all.filter(move |node| node.has_tag_name("camera") && node.ancestors().all(|above| is_on(&above)))
}

/// The model of a camera's sensor.
fn model_of<'a>(camera: Node<'_, '_>, sensors: &'a BTreeMap<&str, Check<SensorModel>>) -> Check<&'a SensorModel> {
    let id = camera.attribute("sensor_id").ok_or("has no sensor_id")?;
    let sensor = sensors.get(id).ok_or_else(|| {
        format!(
            "its sensor {} is not among the {} of the file",
            excerpt(id),
            sensors.len()
        )
    })?;
    sensor
        .as_ref()
        .map_err(|what| format!("sensor {}: {what}", excerpt(id)))
}

/// The matrix of a camera that has a pose.
fn matrix_of<'a, 'i>(camera: Node<'a, 'i>) -> Option<Node<'a, 'i>> {
    xml::child(camera, "transform").filter(|node| !node.text().unwrap_or_default().trim().is_empty())
}

/// Pose in the chunk.
fn pose_of(matrix: Node<'_, '_>) -> Check<Pose> {
    let m: [f64; 16] = xml::numbers(matrix)?;
    if m[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err("the last row of <transform> is not 0 0 0 1".to_owned());
    }
    let column = |i: usize| DVec3::new(m[i], m[4 + i], m[8 + i]);
    let linear = DMat3::from_cols(column(0), column(1), column(2));
    Pose::of_matrix(linear, column(3), "<transform>")
}

/// A pose in the chunk as one in the world.
fn in_world(pose: &Pose, world: &Similarity) -> Check<Pose> {
    let position = world.scale * (world.rotation * pose.position) + world.translation;
    check_position(position)?;
    Ok(Pose {
        rotation: pose.rotation * world.rotation.transpose(),
        position,
        was_scaled: pose.was_scaled,
    })
}
