//! Cameras as RealityCapture's table and as Metashape's list, by the geometry of their axes.

use ashfall::scene::{Camera, Point, Similarity};
use glam::{DMat4, DVec3, DVec4};
use std::fmt::Write as _;

/// Column names of the table.
pub(crate) const COLUMNS: &str = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2";

/// RealityCapture's table of cameras with square pixels and a lens of k1 to k4, t1 and t2.
pub(crate) fn table<'a>(cameras: impl IntoIterator<Item = (&'a str, Camera)>, lens: [f64; 6]) -> String {
    let mut text = format!("{COLUMNS}\n");
    for (label, camera) in cameras {
        let [heading, pitch, roll] = angles(&camera);
        let longer = f64::from(camera.width.max(camera.height));
        let f = camera.focal.x / longer * 36.0;
        let px = (camera.center.x - f64::from(camera.width) / 2.0) / longer;
        let py = (camera.center.y - f64::from(camera.height) / 2.0) / longer;
        let DVec3 { x, y, z } = camera.position;
        let [k1, k2, k3, k4, t1, t2] = lens;
        let row = format!("{label},{x},{y},{z},{heading},{pitch},{roll},{f},{px},{py},{k1},{k2},{k3},{k4},{t1},{t2}");
        writeln!(text, "{row}").unwrap();
    }
    text
}

/// Heading clockwise from y, seen from above, and elevation of the camera's upward axis, and the turn about it of the
/// axis to the right from level, in degrees.
fn angles(camera: &Camera) -> [f64; 3] {
    let (right, up) = (camera.rotation.row(0), -camera.rotation.row(1));
    let heading = up.x.atan2(up.y);
    let level = DVec3::new(heading.cos(), -heading.sin(), 0.0);
    let pitch = up.z.asin();
    let roll = (-right.dot(level.cross(up))).atan2(right.dot(level));
    [heading, pitch, roll].map(f64::to_degrees)
}

/// Metashape's list of cameras in a chunk that `world` leads to the world, all of the sensor 0; `sensors` and
/// `transforms` are elements of the chunk.
pub(crate) fn metashape<'a>(
    cameras: impl IntoIterator<Item = (&'a str, Camera)>,
    world: &Similarity,
    [sensors, transforms]: [&str; 2],
) -> String {
    let world_from_chunk = DMat4::from_mat3(world.rotation * world.scale) + at(world.translation);
    let mut list = String::new();
    for (id, (label, camera)) in cameras.into_iter().enumerate() {
        let pose = DMat4::from_mat3(camera.rotation.transpose()) + at(camera.position);
        let chunk_from_camera = world_from_chunk.inverse() * pose;
        let rigid = DMat4::from_cols(
            chunk_from_camera.x_axis * world.scale,
            chunk_from_camera.y_axis * world.scale,
            chunk_from_camera.z_axis * world.scale,
            chunk_from_camera.w_axis,
        );
        let rows = rigid
            .transpose()
            .to_cols_array()
            .map(|value| value.to_string())
            .join(" ");
        let head = format!("<camera id=\"{id}\" sensor_id=\"0\" component_id=\"0\" label=\"{label}\">");
        writeln!(list, "{head}<transform>{rows}</transform></camera>").unwrap();
    }
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\"><chunk label=\"a\">\n<sensors>{sensors}</sensors>\n\
         {transforms}\n<cameras>{list}</cameras></chunk></document>\n"
    )
}

/// The translation alone, without the 1 in its last place.
fn at(translation: DVec3) -> DMat4 {
    DMat4::from_cols(DVec4::ZERO, DVec4::ZERO, DVec4::ZERO, translation.extend(0.0))
}

/// The component 0 with a transform.
pub(crate) fn component(world: &Similarity) -> String {
    let transform = transform(world);
    format!("<components><component id=\"0\" label=\"a\">{transform}</component></components>")
}

/// A `<transform>` of a chunk or component.
pub(crate) fn transform(world: &Similarity) -> String {
    let words = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let rotation = words(&world.rotation.transpose().to_cols_array());
    let translation = words(&world.translation.to_array());
    format!(
        "<transform><rotation>{rotation}</rotation><translation>{translation}</translation><scale>{}</scale></transform>",
        world.scale
    )
}

/// A sensor with the elements of its calibration.
pub(crate) fn sensor(id: u32, kind: &str, [width, height]: [u32; 2], calibration: &str) -> String {
    format!(
        "<sensor id=\"{id}\" type=\"{kind}\"><resolution width=\"{width}\" height=\"{height}\"/><calibration type=\"{kind}\" \
         class=\"adjusted\"><resolution width=\"{width}\" height=\"{height}\"/>{calibration}</calibration></sensor>"
    )
}

/// A point cloud in text.
pub(crate) fn cloud(points: &[Point]) -> String {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", points.len());
    for (kind, names) in [("double", ["x", "y", "z"]), ("uchar", ["red", "green", "blue"])] {
        for name in names {
            writeln!(text, "property {kind} {name}").unwrap();
        }
    }
    text += "end_header\n";
    for point in points {
        let [x, y, z] = point.position;
        let [r, g, b] = point.color.map(|channel| (255.0 * channel).round());
        writeln!(text, "{x} {y} {z} {r} {g} {b}").unwrap();
    }
    text
}
