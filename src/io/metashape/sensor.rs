//! Sensors: sizes and lenses.
//!
//! With x and y on the sensor in focal lengths, after k1 to k4 and p1, p2 (Metashape's p1 is OpenCV's p2, and the other
//! way round), a pixel is (w / 2 + cx + (f + b1) x + b2 y, h / 2 + cy + f y). Fisheye lenses take the angle from the
//! axis for its tangent; spherical ones are panoramas.

use super::super::check::Check;
use super::super::listing::{check_intrinsics, check_size, panorama};
use super::super::reader::excerpt;
use super::super::xml;
use crate::scene::{Camera, Lens};
use glam::{DMat3, DVec2, DVec3};
use roxmltree::Node;
use std::collections::BTreeMap;

/// A sensor's camera, without a pose, and its lens.
pub(super) struct SensorModel {
    pub(super) camera: Camera,
    /// `None`: a pinhole.
    pub(super) lens: Option<Lens>,
}

/// Sensors by id. A fault of one concerns its cameras alone.
pub(super) fn read_all<'a>(chunk: Node<'a, '_>) -> Check<BTreeMap<&'a str, Check<SensorModel>>> {
    let list = xml::child(chunk, "sensors").ok_or("has no <sensors>")?;
    let mut sensors = BTreeMap::new();
    for sensor in list.children().filter(|node| node.has_tag_name("sensor")) {
        let id = sensor.attribute("id").ok_or("a sensor has no id")?;
        if sensors.insert(id, read(sensor)).is_some() {
            return Err(format!("the sensor {} occurs twice", excerpt(id)));
        }
    }
    Ok(sensors)
}

fn read(sensor: Node<'_, '_>) -> Check<SensorModel> {
    let calibration = calibration(sensor);
    let kind = |node: Node<'_, '_>| node.attribute("type").map(str::to_owned);
    let kind = calibration
        .and_then(kind)
        .or_else(|| kind(sensor))
        .unwrap_or("frame".to_owned());
    // Focal lengths belong to the size that stands beside them.
    let resolution = calibration
        .and_then(|node| xml::child(node, "resolution"))
        .or_else(|| xml::child(sensor, "resolution"))
        .ok_or("has no <resolution>")?;
    let (width, height) = check_size(xml::whole(resolution, "width")?, xml::whole(resolution, "height")?)?;
    let size = DVec2::new(width.into(), height.into());
    let (focal, center, lens) = match kind.as_str() {
        "frame" => perspective(calibration.ok_or("has no <calibration>")?, size, false)?,
        "fisheye" | "equidistant_fisheye" => perspective(calibration.ok_or("has no <calibration>")?, size, true)?,
        "spherical" => panorama(size.to_array()),
        other => {
            let other = excerpt(other);
            return Err(format!(
                "the type {other} is not supported (frame, fisheye and spherical are): undistort the photographs first"
            ));
        }
    };
    check_intrinsics(focal, center)?;
    Ok(SensorModel {
        camera: Camera {
            width,
            height,
            focal: DVec2::from(focal),
            center: DVec2::from(center),
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        },
        lens: Some(lens.simplified()).filter(|lens| !lens.is_none()),
    })
}

/// The adjusted calibration, else the first.
fn calibration<'a, 'i>(sensor: Node<'a, 'i>) -> Option<Node<'a, 'i>> {
    let all = || sensor.children().filter(|node| node.has_tag_name("calibration"));
    let adjusted = all().find(|node| node.attribute("class") == Some("adjusted"));
    adjusted.or_else(|| all().next())
}

/// Focal lengths, principal point and lens.
fn perspective(calibration: Node<'_, '_>, size: DVec2, is_angular: bool) -> Check<([f64; 2], [f64; 2], Lens)> {
    let value = |name: &str| xml::number(calibration, name).map(|value| value.unwrap_or(0.0));
    for name in ["p3", "p4"] {
        let value = value(name)?;
        if value != 0.0 {
            return Err(format!("the distortion coefficient {name} = {value} is not supported"));
        }
    }
    // Files of PhotoScan have two focal lengths.
    let [x, y] = match xml::number(calibration, "f")? {
        Some(f) => [f + value("b1")?, f],
        None => {
            let given = |name: &str| xml::number(calibration, name)?.ok_or("the calibration has no <f>".to_owned());
            [given("fx")?, given("fy")?]
        }
    };
    let shear = match value("b2")? {
        0.0 => 0.0,
        b2 => b2 / x,
    };
    if !shear.is_finite() {
        return Err(format!("a focal length of {x} pixels is not positive"));
    }
    let center = 0.5 * size + DVec2::new(value("cx")?, value("cy")?);
    let lens = Lens::Polynomial {
        is_angular,
        radial: [value("k1")?, value("k2")?, value("k3")?, value("k4")?],
        tangential: [value("p2")?, value("p1")?],
        shear,
    };
    Ok(([x, y], center.to_array(), lens))
}
