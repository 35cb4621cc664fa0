//! COLMAP's binary form: little-endian records after a 64-bit count.

use super::super::reader::Reader;
use super::super::source::Source;
use super::camera::{Intrinsics, model_from_id};
use super::{ImageRecord, PointWithId};
use crate::error::Result;
use crate::scene::Point;
use std::collections::BTreeMap;

/// Longest image name accepted, in bytes.
const NAME_BYTES_MAX: u64 = 4096;

/// id, model, width, height and two parameters.
const CAMERA_BYTES_MIN: u64 = 4 + 4 + 8 + 8 + 2 * 8;
/// id, pose, camera, an empty name and the count of 2D points.
const IMAGE_BYTES_MIN: u64 = 4 + 7 * 8 + 4 + 1 + 8;
const POINT2D_BYTES: u64 = 8 + 8 + 8;
/// Point id of a 2D point without one: −1.
const NO_POINT: u64 = u64::MAX;
/// id, position, colour, error and the length of the track.
const POINT3D_BYTES_MIN: u64 = 8 + 3 * 8 + 3 + 8 + 8;
const TRACK_ELEMENT_BYTES: u64 = 4 + 4;

pub(super) fn cameras(source: Source<'_>) -> Result<BTreeMap<u32, Intrinsics>> {
    let mut reader = Reader::open(source)?;
    let count = reader.u64("the number of cameras")?;
    let count = reader.check_count(count, CAMERA_BYTES_MIN, "cameras")?;
    let mut lenses = BTreeMap::new();
    for _ in 0..count {
        let id = reader.u32("a camera")?;
        let model = reader.u32("a camera")?.cast_signed();
        let named = |what: String| format!("camera {id}: {what}");
        let (model, parameter_count) = model_from_id(model).map_err(|what| reader.fault(named(what)))?;
        let width = reader.u64("a camera")?;
        let height = reader.u64("a camera")?;
        let mut parameters = Vec::with_capacity(parameter_count);
        for _ in 0..parameter_count {
            parameters.extend(reader.f64s::<1>("the parameters of a camera")?);
        }
        let lens = Intrinsics::new(model, width, height, &parameters).map_err(|what| reader.fault(named(what)))?;
        if lenses.insert(id, lens).is_some() {
            return Err(reader.fault(format!("camera {id} occurs twice")));
        }
    }
    Ok(lenses)
}

pub(super) fn images(source: Source<'_>) -> Result<Vec<ImageRecord>> {
    let mut reader = Reader::open(source)?;
    let count = reader.u64("the number of images")?;
    let count = reader.check_count(count, IMAGE_BYTES_MIN, "images")?;
    let mut images = Vec::with_capacity(count);
    for _ in 0..count {
        let id = reader.u32("an image")?;
        let quaternion = reader.f64s("the rotation of an image")?;
        let translation = reader.f64s("the translation of an image")?;
        let camera = reader.u32("an image")?;
        let name = reader.zero_terminated(NAME_BYTES_MAX, "the name of an image")?;
        let name = String::from_utf8(name).map_err(|_| reader.fault(format!("the name of image {id} is not UTF-8")))?;
        let points = reader.u64("the number of 2D points")?;
        let points = reader.check_count(points, POINT2D_BYTES, "2D points")?;
        let mut seen = Vec::new();
        for _ in 0..points {
            let _place: [f64; 2] = reader.f64s("a 2D point")?;
            seen.extend(Some(reader.u64("a 2D point")?).filter(|id| *id != NO_POINT));
        }
        images.push(ImageRecord {
            id,
            name,
            quaternion,
            translation,
            camera,
            seen,
        });
    }
    Ok(images)
}

pub(super) fn points(source: Source<'_>) -> Result<Vec<PointWithId>> {
    let mut reader = Reader::open(source)?;
    let count = reader.u64("the number of points")?;
    let count = reader.check_count(count, POINT3D_BYTES_MIN, "points")?;
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        let id = reader.u64("a point")?;
        let position: [f64; 3] = reader.f64s("the position of a point")?;
        let color: [u8; 3] = reader.array("the colour of a point")?;
        let _error: [f64; 1] = reader.f64s("the error of a point")?;
        let track = reader.u64("the length of a track")?;
        let track = reader.check_count(track, TRACK_ELEMENT_BYTES, "track elements")?;
        reader.skip(track as u64 * TRACK_ELEMENT_BYTES, "a track")?;
        let point = Point {
            position,
            color: color.map(|c| f32::from(c) / 255.0),
        };
        points.push((id, point));
    }
    Ok(points)
}
