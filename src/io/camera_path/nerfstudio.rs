//! `camera_path.json` of nerfstudio's viewer, and the way from its normalised world.
//!
//! `camera_to_world` has 16 numbers by rows, camera axes x right, y up, z backward; `fov` is the vertical field of view
//! in degrees. A position p of the data set's world, before its `applied_transform`, is scale · (R p + t) in the
//! normalised one, with `transform` = (R | t) and `scale` of `dataparser_transforms.json`.

use super::super::check::Check;
use super::super::json::{self, matrix, needed, number, numbers, object, text, whole};
use super::super::listing::check_size;
use super::super::pose::{Pose, rotation};
use super::super::reader::{Reader, excerpt};
use super::super::source::Source;
use super::{CameraPath, DATAPARSER, pinhole};
use crate::error::{Error, Result};
use crate::scene::{Camera, Similarity};
use glam::{DMat3, DVec3};
use serde_json::{Map, Value};
use std::path::Path;

/// Cameras of a document, by `world` from the normalised world.
pub(super) fn read(path: &Path, root: &Map<String, Value>, world: Option<&Similarity>) -> Check<CameraPath> {
    perspective(root)?;
    let side = |key| needed(root, key).and_then(whole);
    let (width, height) = check_size(side("render_width")?, side("render_height")?)?;
    let list = match root.get("camera_path") {
        Some(Value::Array(list)) if !list.is_empty() => list,
        Some(Value::Array(_)) => return Err("\"camera_path\" is empty: render the path in the viewer first".into()),
        _ => return Err("\"camera_path\" is not a list".into()),
    };
    let mut result = CameraPath {
        rate: number(root, "fps")?.filter(|rate| *rate > 0.0),
        is_closed: root.get("is_cycle") == Some(&Value::Bool(true)),
        ..CameraPath::default()
    };
    for (index, value) in list.iter().enumerate() {
        let camera = camera(value, [width, height]).map_err(|what| format!("camera {index}: {what}"))?;
        result.cameras.push(world.map_or(camera, |world| world.moved(&camera)));
    }
    let path = path.display();
    if world.is_none() {
        result.warnings.push(format!(
            "{path}: no {DATAPARSER} beside it: the scene is taken to be in nerfstudio's normalised world, as its \
             exports are"
        ));
    }
    if root.get("crop").is_some_and(|crop| !crop.is_null()) {
        result.warnings.push(format!("{path}: its crop box is left out"));
    }
    Ok(result)
}

/// Refuses camera types other than perspective.
fn perspective(level: &Map<String, Value>) -> Check<()> {
    match text(level, "camera_type")? {
        None | Some("perspective") => Ok(()),
        Some(other) => Err(format!(
            "cameras of the type {} are not supported (perspective ones are)",
            excerpt(other)
        )),
    }
}

fn camera(value: &Value, size: [u32; 2]) -> Check<Camera> {
    let value = object(value)?;
    perspective(value)?;
    let m = numbers::<16>(value, "camera_to_world")?;
    let column = |i: usize| DVec3::new(m[i], m[4 + i], m[8 + i]);
    let linear = DMat3::from_cols(column(0), column(1), column(2));
    let pose = Pose::of_opengl(linear, column(3), "\"camera_to_world\"")?;
    let field = needed(value, "fov")?;
    if !(field > 0.0 && field < 180.0) {
        return Err(format!("a field of view of {field} degrees is not between 0 and 180"));
    }
    let focal = 0.5 * f64::from(size[1]) / (0.5 * field.to_radians()).tan();
    pinhole(size, [focal; 2], &pose)
}

/// The map from nerfstudio's normalised world to that before `applied_transform`, by a `dataparser_transforms.json`.
///
/// # Errors
/// Names the file: not JSON, missing keys, a transform that is no rotation with a translation, a scale that is not
/// positive.
pub fn normalised_world<'a>(source: impl Into<Source<'a>>) -> Result<Similarity> {
    document(source.into(), |root| {
        let rigid = rigid(root, "transform")?;
        let scale = needed(root, "scale")?;
        if !(1e-12..=1e12).contains(&scale) {
            return Err(format!("a \"scale\" of {scale} is not between 1e-12 and 1e12"));
        }
        let scaled = Similarity {
            scale,
            translation: scale * rigid.translation,
            ..rigid
        };
        Ok(scaled.inverse())
    })
}

/// The `applied_transform` of a `transforms.json`, from the original world to that of its cameras; identity without.
///
/// # Errors
/// As for [`normalised_world`].
pub fn applied_transform<'a>(source: impl Into<Source<'a>>) -> Result<Similarity> {
    document(source.into(), |root| match root.get("applied_transform") {
        None | Some(Value::Null) => Ok(Similarity::IDENTITY),
        Some(_) => rigid(root, "applied_transform"),
    })
}

fn document(source: Source<'_>, read: impl FnOnce(&Map<String, Value>) -> Check<Similarity>) -> Result<Similarity> {
    let path = source.name();
    let root = json::parse(path, &Reader::all(source)?)?;
    let root = object(&root).map_err(|what| format!("the top level {what}"));
    root.and_then(read).map_err(|what| Error::file(path, what))
}

/// Rotation and translation of three or four rows of four numbers.
fn rigid(root: &Map<String, Value>, key: &str) -> Check<Similarity> {
    let rows = matrix::<3, 4>(root, key)?;
    let column = |i: usize| DVec3::new(rows[0][i], rows[1][i], rows[2][i]);
    let (rotation, scale) = rotation(DMat3::from_cols(column(0), column(1), column(2)), &format!("{key:?}"))?;
    if (scale - 1.0).abs() > 1e-3 {
        return Err(format!("{key:?} has a scale of {scale}"));
    }
    Ok(Similarity {
        rotation,
        scale: 1.0,
        translation: column(3),
    })
}
