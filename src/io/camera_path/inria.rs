//! `cameras.json` of the 3DGS code: a list of cameras, test views first.
//!
//! `rotation` has the rows of the matrix from camera to world, camera axes x right, y down, z forward; `position` is
//! the centre; the principal point is the middle.

use super::super::check::Check;
use super::super::json::{matrix, needed, numbers, object, whole};
use super::super::listing::check_size;
use super::super::pose::Pose;
use super::{CameraPath, pinhole};
use crate::scene::Camera;
use glam::{DMat3, DVec3};
use serde_json::Value;

pub(super) fn read(list: &[Value]) -> Check<CameraPath> {
    if list.is_empty() {
        return Err("is an empty list, without cameras".into());
    }
    let named = |(index, value)| camera(value).map_err(|what| format!("camera {index}: {what}"));
    Ok(CameraPath {
        cameras: list.iter().enumerate().map(named).collect::<Check<_>>()?,
        ..CameraPath::default()
    })
}

fn camera(value: &Value) -> Check<Camera> {
    let value = object(value)?;
    let side = |key| needed(value, key).and_then(whole);
    let (width, height) = check_size(side("width")?, side("height")?)?;
    let rows = matrix::<3, 3>(value, "rotation")?.map(DVec3::from);
    let linear = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
    let pose = Pose::of_matrix(linear, DVec3::from(numbers::<3>(value, "position")?), "\"rotation\"")?;
    pinhole([width, height], [needed(value, "fx")?, needed(value, "fy")?], &pose)
}
