//! Poses by rigs and frames, binary form of COLMAP 3.12 and later: `sensor_from_rig` after `rig_from_world`.
//!
//! `images` has the same poses, but programs that move frames may leave them as they were.

use super::super::reader::Reader;
use super::super::source::Source;
use crate::error::Result;
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;

/// Sensor type of a camera; others are inertial.
const CAMERA: u32 = 0;

/// id and number of sensors.
const RIG_BYTES_MIN: u64 = 4 + 4;
/// type, id and whether there is a pose.
const SENSOR_BYTES_MIN: u64 = 4 + 4 + 1;
/// id, rig, pose and number of images.
const FRAME_BYTES_MIN: u64 = 4 + 4 + 7 * 8 + 4;
/// type, id and image.
const DATA_BYTES: u64 = 4 + 4 + 8;

/// Largest difference of a pose in `images`: of a quaternion, and of a translation for each unit of its length.
const DIFFERENCE_MAX: f64 = 1e-6;

/// Rotation and translation.
pub(in super::super) type RigidMotion = (DQuat, DVec3);

/// A sensor of a rig: the rig's id, the sensor's type and id.
type SensorKey = (u32, u32, u32);

/// `view_from_world` of images by id.
pub(super) fn poses(rigs: Source<'_>, frames: Source<'_>) -> Result<BTreeMap<u64, RigidMotion>> {
    let sensors = sensors(rigs)?;
    let mut reader = Reader::open(frames)?;
    let count = reader.u64("the number of frames")?;
    let count = reader.check_count(count, FRAME_BYTES_MIN, "frames")?;
    let mut poses = BTreeMap::new();
    for _ in 0..count {
        let id = reader.u32("a frame")?;
        let rig = reader.u32("a frame")?;
        let (turn, shift) = rigid(&mut reader, "frame", id)?;
        let data = reader.u32("the images of a frame")?;
        let data = reader.check_count(data.into(), DATA_BYTES, "images of a frame")?;
        for _ in 0..data {
            let sensor = [reader.u32("a sensor")?, reader.u32("a sensor")?];
            let image = reader.u64("an image of a frame")?;
            if sensor[0] != CAMERA {
                continue;
            }
            let key = (rig, sensor[0], sensor[1]);
            let Some(own) = sensors.get(&key) else {
                return Err(reader.fault(format!("frame {id}: camera {} is not in rig {rig}", sensor[1])));
            };
            // A sensor without a pose has that of `images` alone.
            if let Some((rotation, translation)) = own {
                poses.insert(image, (*rotation * turn, *rotation * shift + *translation));
            }
        }
    }
    Ok(poses)
}

/// `sensor_from_rig` of each sensor; `None` where it is unknown.
fn sensors(rigs: Source<'_>) -> Result<BTreeMap<SensorKey, Option<RigidMotion>>> {
    let mut reader = Reader::open(rigs)?;
    let count = reader.u64("the number of rigs")?;
    let count = reader.check_count(count, RIG_BYTES_MIN, "rigs")?;
    let mut sensors = BTreeMap::new();
    for _ in 0..count {
        let rig = reader.u32("a rig")?;
        let all = reader.u32("the sensors of a rig")?;
        let all = reader.check_count(all.into(), SENSOR_BYTES_MIN - 1, "sensors of a rig")?;
        for place in 0..all {
            let key = (rig, reader.u32("a sensor")?, reader.u32("a sensor")?);
            // The first is the rig's own origin.
            let pose = match place == 0 {
                true => Some((DQuat::IDENTITY, DVec3::ZERO)),
                false if reader.array::<1>("a sensor")? == [0] => None,
                false => Some(rigid(&mut reader, "rig", rig)?),
            };
            sensors.insert(key, pose);
        }
    }
    Ok(sensors)
}

fn rigid(reader: &mut Reader<'_>, name: &str, id: u32) -> Result<RigidMotion> {
    let [w, x, y, z]: [f64; 4] = reader.f64s("a rotation")?;
    let translation = DVec3::from(reader.f64s::<3>("a translation")?);
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let length = rotation.length();
    if !(length.is_finite() && length > 1e-9 && translation.is_finite()) {
        return Err(reader.fault(format!("{name} {id} has no pose: {w} {x} {y} {z}, {translation}")));
    }
    Ok((rotation / length, translation))
}

/// The pose of rigs and frames as the numbers of `images`, if theirs differ from it: w, x, y, z and translation.
pub(in super::super) fn corrected(own: [f64; 7], (rotation, translation): &RigidMotion) -> Option<[f64; 7]> {
    let [w, x, y, z, shift @ ..] = own;
    let given = DQuat::from_xyzw(x, y, z, w).normalize();
    // Both signs of a quaternion are one rotation.
    let turned = (given - *rotation).length().min((given + *rotation).length());
    let moved = (DVec3::from(shift) - *translation).length() / (1.0 + translation.length());
    // NaN differs, too.
    if turned <= DIFFERENCE_MAX && moved <= DIFFERENCE_MAX {
        return None;
    }
    let DQuat { w, x, y, z } = *rotation;
    let [a, b, c] = translation.to_array();
    Some([w, x, y, z, a, b, c])
}
