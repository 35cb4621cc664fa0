//! What a reconstruction lists, before its photographs have been looked at.

use crate::scene::{Camera, Distortion, Point};
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
    Ok(())
}

/// `folder`/`name`, where `name` is relative and does not leave the folder.
pub(super) fn inside(folder: &Path, name: &str) -> Check<PathBuf> {
    let mut parts = Path::new(name).components();
    let tame = parts.all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if name.is_empty() || name.contains('\0') || !tame {
        return Err(format!(
            "the file name {} is refused: it must be relative and stay inside {}",
            super::reader::excerpt(name),
            folder.display()
        ));
    }
    Ok(folder.join(name))
}
