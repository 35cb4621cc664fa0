//! COLMAP camera models that can be undistorted to a pinhole.

use super::super::listing::{Check, check_intrinsics, check_size};
use crate::scene::Distortion;
use glam::DVec2;

/// Intrinsics shared by images.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lens {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) focal: DVec2,
    pub(super) center: DVec2,
    pub(super) distortion: Option<Distortion>,
}

/// Name and number of parameters, in the order of the ids (COLMAP, `src/colmap/sensor/models.h`).
const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// Name and number of parameters of a model id.
pub(super) fn model_from_id(id: i32) -> Check<(&'static str, usize)> {
    usize::try_from(id)
        .ok()
        .and_then(|id| MODELS.get(id).copied())
        .ok_or_else(|| format!("unknown camera model id {id}"))
}

/// Number of parameters of a model name.
pub(super) fn parameters_of(name: &str) -> Check<usize> {
    MODELS
        .iter()
        .find(|(known, _)| *known == name)
        .map(|(_, count)| *count)
        .ok_or_else(|| format!("unknown camera model {}", super::super::reader::excerpt(name)))
}

impl Lens {
    /// Validates a camera's entry; `parameters` must have the model's length.
    pub(super) fn new(model: &str, width: u64, height: u64, parameters: &[f64]) -> Check<Lens> {
        let (width, height) = check_size(width, height)?;
        let none = Distortion::default();
        let radial = |k1, k2| Distortion { k1, k2, ..none };
        let (focal, center, distortion) = match (model, parameters) {
            ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f], [cx, cy], none),
            ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy], [cx, cy], none),
            ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f], [cx, cy], radial(k, 0.0)),
            ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], radial(k1, k2)),
            ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => ([fx, fy], [cx, cy], Distortion { k1, k2, p1, p2 }),
            _ => {
                return Err(format!(
                    "the camera model {model} is not supported: undistort the photographs with \
                     COLMAP's image_undistorter and use its output"
                ));
            }
        };
        check_intrinsics(focal, center)?;
        let Distortion { k1, k2, p1, p2 } = distortion;
        if ![k1, k2, p1, p2].iter().all(|k| k.is_finite()) {
            return Err(format!("the distortion {k1}, {k2}, {p1}, {p2} is not finite"));
        }
        Ok(Lens {
            width,
            height,
            focal: DVec2::from(focal),
            center: DVec2::from(center),
            distortion: (distortion != none).then_some(distortion),
        })
    }
}
