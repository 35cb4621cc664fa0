//! What a reconstruction lists, before its photographs have been looked at.

use crate::scene::{Camera, Distortion, Point};
use glam::DVec3;
use std::path::{Component, Path, PathBuf};

/// A view as a reconstruction lists it.
#[derive(Clone, Debug, PartialEq)]
pub struct Listed {
    /// The photograph's name in the reconstruction.
    pub name: String,
    /// Where the photograph should be; nothing says that it is there.
    pub photo: PathBuf,
    /// The camera as the reconstruction has it, at the size it declares.
    pub camera: Camera,
    /// Lens distortion, if there is any.
    pub distortion: Option<Distortion>,
    /// Whether the reconstruction itself holds the view out for testing.
    pub held_out: bool,
}

/// A reconstruction: views in the order of the file, points, and what had to be repaired.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Listing {
    /// The views.
    pub views: Vec<Listed>,
    /// The points as stored, some possibly not finite.
    pub points: Vec<Point>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// A check that does not know the file yet; the caller names it.
pub(super) type Check<T> = Result<T, String>;

/// The longest side of a photograph in pixels (that of the JPEG format).
pub(super) const SIDE_MAX: u32 = 65_535;

/// The most pixels of a photograph: 1 GiB once decoded.
pub(super) const PIXELS_MAX: u64 = 1 << 28;

/// Refuses sizes no photograph has, before anything is allocated for them.
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

/// Refuses intrinsics that no pinhole has.
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

/// Focal lengths below this, in pixels, see the whole half space in one pixel.
const LENGTH_MIN: f64 = 1e-3;

/// Focal lengths and principal points beyond this, in pixels, lie where single precision, in which cameras
/// are rendered, is coarser than images are large.
const LENGTH_MAX: f64 = 1e12;

/// Camera centres beyond this, in world units, lie where squares of distances overflow in single precision.
const POSITION_MAX: f64 = 1e18;

/// Refuses a camera's centre that single precision, in which cameras are rendered, does not hold.
pub(super) fn check_position(position: DVec3) -> Check<()> {
    if position.abs().max_element() <= POSITION_MAX && position.is_finite() {
        return Ok(());
    }
    let DVec3 { x, y, z } = position;
    Err(format!(
        "a camera at {x}, {y}, {z} ({POSITION_MAX} world units are the limit)"
    ))
}

/// `folder`/`name`, where `name` is relative and does not leave the folder.
pub(super) fn inside(folder: &Path, name: &str) -> Check<PathBuf> {
    let mut parts = Path::new(name).components();
    let tame = parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    // Names are printed, and results are named after them: control characters have no place in them.
    if name.is_empty() || name.contains(char::is_control) || !tame {
        return Err(format!(
            "the file name {} is refused: it must be relative and stay inside {}",
            super::reader::excerpt(name),
            folder.display()
        ));
    }
    Ok(folder.join(name))
}
