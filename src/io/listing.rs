//! Views and points listed by a reconstruction, before its photographs are checked.

use super::check::Check;
use crate::scene::{Camera, Lens, Point};
use glam::DVec3;
use std::path::PathBuf;

/// A view listed by a reconstruction.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedView {
    /// Name of the photograph in the reconstruction.
    pub name: String,
    /// Expected path of the photograph; the file may be missing.
    pub photo: PathBuf,
    /// Camera at the size that the reconstruction declares.
    pub camera: Camera,
    /// Lens; `None`: a pinhole. The camera has its focal lengths and principal point.
    pub lens: Option<Lens>,
    /// Mask of the photograph, if any.
    pub mask: Option<PathBuf>,
    /// Held out for testing by the reconstruction itself.
    pub held_out: bool,
    /// Indices of the points seen, ascending; empty if the reconstruction does not tell.
    pub seen: Vec<u32>,
}

/// A reconstruction: views in file order, points, and warnings about repairs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Listing {
    /// The views.
    pub views: Vec<ListedView>,
    /// Points as stored, some possibly not finite.
    pub points: Vec<Point>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Longest side of a photograph in pixels (that of the JPEG format).
pub(super) const SIDE_MAX: u32 = 65_535;

/// Most pixels of a photograph: 1 GiB once decoded.
pub(super) const PIXELS_MAX: u64 = 1 << 28;

/// Refuses invalid photograph sizes before anything is allocated for them.
pub(super) fn check_size(width: u64, height: u64) -> Check<(u32, u32)> {
    let side = |v: u64| u32::try_from(v).ok().filter(|v| (1..=SIDE_MAX).contains(v));
    match (side(width), side(height)) {
        (Some(w), Some(h)) if width * height <= PIXELS_MAX => Ok((w, h)),
        _ => Err(format!(
            "an image size of {width} x {height} pixels (1 to {SIDE_MAX} a side and {PIXELS_MAX} \
             in all are possible)"
        )),
    }
}

/// Refuses invalid pinhole intrinsics.
pub(super) fn check_intrinsics(focal: [f64; 2], center: [f64; 2]) -> Check<()> {
    if !focal.iter().all(|f| f.is_finite() && *f > 0.0) {
        return Err(format!(
            "a focal length of {}, {} pixels is not positive",
            focal[0], focal[1]
        ));
    }
    if !center.iter().all(|c| c.is_finite()) {
        let [x, y] = center;
        return Err(format!("a principal point of {x}, {y} is not finite"));
    }
    let lengths = focal.iter().chain(&center).map(|v| v.abs());
    if !focal.iter().all(|f| *f >= LENGTH_MIN) || !lengths.clone().all(|v| v <= LENGTH_MAX) {
        let [[fx, fy], [cx, cy]] = [focal, center];
        return Err(format!(
            "a focal length of {fx}, {fy} and a principal point of {cx}, {cy} pixels ({LENGTH_MIN} and \
             {LENGTH_MAX} are the limits)"
        ));
    }
    Ok(())
}

/// Least focal length in pixels; below it one pixel covers the whole half space.
const LENGTH_MIN: f64 = 1e-3;

/// Limit of focal lengths and principal points in pixels; beyond it the spacing of single precision, used in rendering,
/// exceeds the size of images.
const LENGTH_MAX: f64 = 1e12;

/// Limit of camera centres in world units; beyond it squares of distances overflow in single precision.
const POSITION_MAX: f64 = 1e18;

/// Refuses a camera centre that is not finite or beyond [`POSITION_MAX`].
pub(super) fn check_position(position: DVec3) -> Check<()> {
    if position.abs().max_element() <= POSITION_MAX && position.is_finite() {
        return Ok(());
    }
    let DVec3 { x, y, z } = position;
    Err(format!(
        "a camera at {x}, {y}, {z} ({POSITION_MAX} world units are the limit)"
    ))
}

/// Intrinsics of a panorama: longitudes across the width, latitudes down the height.
pub(super) fn panorama([width, height]: [f64; 2]) -> ([f64; 2], [f64; 2], Lens) {
    let focal = [width / std::f64::consts::TAU, height / std::f64::consts::PI];
    (focal, [width / 2.0, height / 2.0], Lens::Equirectangular)
}
