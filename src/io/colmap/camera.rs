//! COLMAP camera models.

use super::super::check::Check;
use super::super::listing::{check_intrinsics, check_size, panorama};
use crate::scene::{Distortion, Lens};
use glam::DVec2;

/// Intrinsics shared by images.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Intrinsics {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) focal: DVec2,
    pub(super) center: DVec2,
    /// `None`: a pinhole.
    pub(super) lens: Option<Lens>,
}

/// Name and number of parameters, in the order of the ids (COLMAP 4.1, `src/colmap/sensor/models.h`).
const MODELS: [(&str, usize); 18] = [
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
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
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

impl Intrinsics {
    /// Validates a camera's entry; `parameters` must have the model's length.
    pub(super) fn new(model: &str, width: u64, height: u64, parameters: &[f64]) -> Check<Intrinsics> {
        let (width, height) = check_size(width, height)?;
        let size = [f64::from(width), f64::from(height)];
        let (focal, center, lens) =
            read(model, size, parameters).ok_or_else(|| format!("{model} has not {} parameters", parameters.len()))?;
        check_intrinsics(focal, center)?;
        let coefficients = &parameters[parameters.len().min(3)..];
        if !coefficients.iter().all(|k| k.is_finite()) {
            return Err(format!("the distortion of {model} is not finite: {coefficients:?}"));
        }
        Ok(Intrinsics {
            width,
            height,
            focal: DVec2::from(focal),
            center: DVec2::from(center),
            lens: Some(lens.simplified()).filter(|lens| !lens.is_none()),
        })
    }
}

/// Focal lengths, principal point and lens of a model's parameters.
fn read(model: &str, size: [f64; 2], parameters: &[f64]) -> Option<([f64; 2], [f64; 2], Lens)> {
    let brown = |k1, k2, p1, p2| Lens::Brown(Distortion { k1, k2, p1, p2 });
    let fisheye = |k1, k2| Lens::Fisheye([k1, k2, 0.0, 0.0]);
    Some(match (model, parameters) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f], [cx, cy], brown(0.0, 0.0, 0.0, 0.0)),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy], [cx, cy], brown(0.0, 0.0, 0.0, 0.0)),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f], [cx, cy], brown(k, 0.0, 0.0, 0.0)),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], brown(k1, k2, 0.0, 0.0)),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => ([fx, fy], [cx, cy], brown(k1, k2, p1, p2)),
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => ([fx, fy], [cx, cy], Lens::Fisheye([k1, k2, k3, k4])),
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            let (radial, tangential) = ([k1, k2, k3, k4, k5, k6], [p1, p2]);
            ([fx, fy], [cx, cy], Lens::Rational { radial, tangential })
        }
        ("FOV", &[fx, fy, cx, cy, omega]) => ([fx, fy], [cx, cy], Lens::FieldOfView(omega)),
        ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k]) => ([f, f], [cx, cy], fisheye(k, 0.0)),
        ("RADIAL_FISHEYE", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], fisheye(k1, k2)),
        ("THIN_PRISM_FISHEYE", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx, sy]) => {
            let lens = Lens::ThinPrism {
                radial: [k1, k2, k3, k4],
                tangential: [p1, p2],
                prism: [sx, sy],
            };
            ([fx, fy], [cx, cy], lens)
        }
        ("RAD_TAN_THIN_PRISM_FISHEYE", &[fx, fy, cx, cy, k0, k1, k2, k3, k4, k5, p0, p1, s0, s1, s2, s3]) => {
            let lens = Lens::RadTanThinPrism {
                radial: [k0, k1, k2, k3, k4, k5],
                tangential: [p0, p1],
                prism: [s0, s1, s2, s3],
            };
            ([fx, fy], [cx, cy], lens)
        }
        ("SIMPLE_DIVISION", &[f, cx, cy, k]) => ([f, f], [cx, cy], Lens::Division(k)),
        ("DIVISION", &[fx, fy, cx, cy, k]) => ([fx, fy], [cx, cy], Lens::Division(k)),
        ("SIMPLE_FISHEYE", &[f, cx, cy]) => ([f, f], [cx, cy], fisheye(0.0, 0.0)),
        ("FISHEYE", &[fx, fy, cx, cy]) => ([fx, fy], [cx, cy], fisheye(0.0, 0.0)),
        ("EUCM", &[fx, fy, cx, cy, alpha, beta]) => ([fx, fy], [cx, cy], Lens::Unified([alpha, beta])),
        ("EQUIRECTANGULAR", &[_, _]) => panorama(size),
        _ => return None,
    })
}
