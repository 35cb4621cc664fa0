//! Lens of a frame: nerfstudio's camera models.

use super::super::check::Check;
use super::super::json::number;
use super::super::listing::{check_intrinsics, panorama};
use super::scope::Scope;
use crate::scene::{Distortion, Lens};
use serde_json::Value;

/// Camera models of a perspective lens.
const PERSPECTIVE: [&str; 6] = [
    "OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "FULL_OPENCV",
];

/// Camera models of an equidistant lens.
const FISHEYE: [&str; 3] = ["OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"];

/// Focal lengths, principal point and lens. Without a camera model, a perspective one with the coefficients given.
pub(super) fn read(scope: &Scope<'_>, width: u32, height: u32) -> Check<([f64; 2], [f64; 2], Lens)> {
    let model = scope.text("camera_model")?;
    let size = [f64::from(width), f64::from(height)];
    if model == Some("EQUIRECTANGULAR") {
        return Ok(panorama(size));
    }
    let is_fisheye = model.is_some_and(|model| FISHEYE.contains(&model))
        || (model.is_none() && scope.value("is_fisheye") == Some(&Value::Bool(true)));
    if let Some(model) = model.filter(|model| !is_fisheye && !PERSPECTIVE.contains(model)) {
        let model = super::super::reader::excerpt(model);
        return Err(format!(
            "the camera model {model} is not supported: undistort the photographs first"
        ));
    }
    let focal = focal(scope, width, height)?;
    let center = [
        scope.number("cx")?.unwrap_or(size[0] / 2.0),
        scope.number("cy")?.unwrap_or(size[1] / 2.0),
    ];
    check_intrinsics(focal, center)?;
    let mut radial = [0.0; 6];
    for (k, key) in radial.iter_mut().zip(["k1", "k2", "k3", "k4", "k5", "k6"]) {
        *k = scope.number(key)?.unwrap_or(0.0);
    }
    let [k1, k2, k3, k4, k5, k6] = radial;
    let tangential = [scope.number("p1")?.unwrap_or(0.0), scope.number("p2")?.unwrap_or(0.0)];
    let [p1, p2] = tangential;
    let lens = match model {
        _ if is_fisheye => Lens::Fisheye([k1, k2, k3, k4]),
        Some("FULL_OPENCV") => Lens::Rational { radial, tangential },
        // The fourth coefficient has another meaning in each program that writes it.
        _ if [k4, k5, k6] != [0.0; 3] => {
            let key = ["k4", "k5", "k6"][[k4, k5, k6].iter().position(|k| *k != 0.0).unwrap_or(0)];
            return Err(format!(
                "the distortion coefficient {key} is not supported without the camera model FULL_OPENCV or \
                 OPENCV_FISHEYE: undistort the photographs first"
            ));
        }
        _ if k3 != 0.0 => Lens::Rational { radial, tangential },
        _ => Lens::Brown(Distortion { k1, k2, p1, p2 }),
    };
    Ok((focal, center, lens))
}

/// Focal lengths in pixels, given or from the angle of view; a frame's before the root's.
fn focal(scope: &Scope<'_>, width: u32, height: u32) -> Check<[f64; 2]> {
    let along = |length: &str, angle: &str, side: u32| -> Check<Option<f64>> {
        for level in [scope.frame, scope.root] {
            if let Some(focal) = number(level, length)? {
                return Ok(Some(focal));
            }
            if let Some(angle) = number(level, angle)? {
                return Ok(Some(0.5 * f64::from(side) / (0.5 * angle).tan()));
            }
        }
        Ok(None)
    };
    let x = along("fl_x", "camera_angle_x", width)?;
    let y = along("fl_y", "camera_angle_y", height)?;
    match (x, y) {
        (Some(x), Some(y)) => Ok([x, y]),
        // Square pixels, if only one is given.
        (Some(x), None) => Ok([x, x]),
        (None, Some(y)) => Ok([y, y]),
        (None, None) => Err("no \"fl_x\" and no \"camera_angle_x\"".to_owned()),
    }
}
