//! The list with other poses.

use super::world::Worlds;
use super::{cameras, chunk_of, in_world, matrix_of, pose_of};
use crate::io::xml;
use glam::{DMat3, DQuat, DVec3};
use std::path::Path;

/// The list with the cameras of some labels moved, by a turn of the world about the camera and a shift of its centre,
/// and all else as it was. `None` if it is no list.
pub(in super::super) fn moved(
    path: &Path,
    bytes: &[u8],
    motion: &dyn Fn(&str) -> Option<(DQuat, DVec3)>,
) -> Option<String> {
    let document = xml::parse(path, bytes).ok()?;
    let chunk = chunk_of(&document).ok()?;
    let worlds = Worlds::read(chunk).ok()?;
    let text = document.input_text();
    let (mut result, mut from) = (String::new(), 0);
    for camera in cameras(chunk) {
        let Some(matrix) = matrix_of(camera) else { continue };
        let Some((turn, shift)) = motion(camera.attribute("label")?) else {
            continue;
        };
        let world = worlds.of(camera.attribute("component_id")).ok()?;
        let pose = in_world(&pose_of(matrix).ok()?, &world).ok()?;
        let view_from_chunk = pose.rotation * DMat3::from_quat(turn) * world.rotation;
        let position = world.rotation.transpose() * (pose.position + shift - world.translation) / world.scale;
        let place = matrix.first_child()?.range();
        result += &text[from..place.start];
        result += &rows(view_from_chunk.transpose(), position);
        from = place.end;
    }
    result += &text[from..];
    Some(result)
}

/// Rows of a matrix from the camera.
fn rows(linear: DMat3, position: DVec3) -> String {
    let row = |i: usize| {
        let [x, y, z] = linear.row(i).to_array();
        format!("{x} {y} {z} {}", position[i])
    };
    format!("{} {} {} 0 0 0 1", row(0), row(1), row(2))
}
