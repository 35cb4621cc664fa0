//! Opening a data set of any supported format.
//!
//! All checks that need no decoded pixels are made here, before training begins: photographs exist and are images,
//! their sizes fit their cameras, and there is at least one view to train on.
//!
#![doc = include_str!("../../../docs/captures.md")]

mod check;
mod faces;
mod masks;
mod reconstruction;
mod views;

use crate::error::{Error, Result};
use crate::scene::{AlphaMode, Dataset, Point, Split, View};
pub use check::check_capture;
use glam::DVec3;
pub use reconstruction::{Reconstruction, photo_folder};
use std::path::{Path, PathBuf};

/// Options for opening a data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpenOptions {
    /// Factor by which photographs are reduced on loading; 1: unchanged.
    pub downscale: u32,
    /// Every `test_every`-th view by name, from the first, is a test view; 0: none. A split of the data set itself
    /// (Blender's) is used instead, unless this is 0.
    pub test_every: usize,
    /// Folder of the photographs, relative to the data set's or absolute; `None`: the format's default (`images` for
    /// COLMAP).
    pub images: Option<PathBuf>,
    /// Meaning of alpha; `None`: [`AlphaMode::Mask`] if undistortion leaves empty borders, else
    /// [`AlphaMode::Composite`].
    pub alpha: Option<AlphaMode>,
    /// Require photographs, and a view to train on; rendering needs cameras only.
    pub photos_required: bool,
    /// Use of mask files.
    pub masks: MaskUse,
}

/// Use of mask files, white where a pixel is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MaskUse {
    /// Pixels that a mask leaves out are ignored.
    #[default]
    Ignore,
    /// Masks are not looked at.
    Off,
    /// Black keeps.
    Inverted,
}

impl Default for OpenOptions {
    fn default() -> OpenOptions {
        OpenOptions {
            downscale: 1,
            test_every: 8,
            images: None,
            alpha: None,
            photos_required: true,
            masks: MaskUse::default(),
        }
    }
}

/// Opens the data set at `path`: a folder with a COLMAP model (in `sparse/0`, `sparse` or itself; it comes first, as it
/// has points), else with `transforms.json` or `transforms_train.json`, a `.csv` of RealityCapture's cameras or an
/// `.xml` of Metashape's; or such a file.
///
/// Views without their photograph are left out with a warning; a file that is not an image, is empty, or has another
/// aspect ratio than its camera is an error. Points that are not finite are dropped with a warning.
///
/// # Errors
/// Names the file and the reason; see [`colmap::read`](super::colmap::read),
/// [`transforms::read`](super::transforms::read), [`realitycapture::read`](super::realitycapture::read) and
/// [`metashape::read`](super::metashape::read). Also: unknown format, no photographs,
/// two views of one name, no view left to train on.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Dataset> {
    if options.downscale == 0 {
        let what = "the factor by which photographs are reduced must be at least 1";
        return Err(Error::Config(what.to_owned()));
    }
    let mut listing = reconstruction::list(path, options)?;
    let mut warnings = std::mem::take(&mut listing.warnings);
    listing.views.sort_by(|a, b| a.name.cmp(&b.name));
    for pair in listing.views.windows(2) {
        if pair[0].name == pair[1].name {
            let what = format!("two views have the name {:?}", pair[0].name);
            return Err(Error::file(path, what));
        }
    }
    let distorted = listing.views.iter().any(|v| v.lens.is_some());
    let views::CheckedViews {
        views,
        held_out,
        mut seen,
    } = views::look_at_photos(path, listing.views, options, &mut warnings)?;
    let masked = masks::look_at_masks(path, &views, options, &mut warnings)?;
    masks::look_at_profile(path, &views, &mut warnings);
    let mut points = listing.points;
    keep_finite_seen(&points, &mut seen);
    keep_finite(path, &mut points, &mut warnings);
    keep_seen_by_sides(&views, &points, &mut seen);
    if options.photos_required && points.is_empty() {
        warnings.push(format!(
            "{}: there are no points; training begins from random ones",
            path.display()
        ));
    }
    warn_if_unseen(path, &views, &points, &mut warnings);
    let alpha = alpha(path, options, [distorted, masked], &mut warnings);
    let mut dataset = Dataset {
        views,
        points,
        tracks: seen,
        test_every: options.test_every,
        held_out,
        alpha,
        warnings,
        origin: DVec3::ZERO,
    };
    if let Some(origin) = dataset.distant_origin() {
        dataset.warnings.push(format!(
            "{}: the cameras are far from the origin; positions are counted from {origin}",
            path.display()
        ));
        dataset.set_origin(origin);
    }
    if options.photos_required && dataset.split(Split::Train).is_empty() {
        let what = format!(
            "no view is left to train on: all {} are test views (every {}th is); hold out fewer",
            dataset.views.len(),
            options.test_every
        );
        return Err(Error::file(path, what));
    }
    Ok(dataset)
}

/// Meaning of alpha for photographs with distortion, and with masks.
fn alpha(path: &Path, options: &OpenOptions, has: [bool; 2], warnings: &mut Vec<String>) -> AlphaMode {
    let [distorted, masked] = has;
    if distorted && options.alpha == Some(AlphaMode::Composite) {
        warnings.push(format!(
            "{}: removing the lens distortion leaves empty borders, which are taken for background as \
             alpha is to be composited",
            path.display()
        ));
    }
    let usual = match distorted || masked {
        true => AlphaMode::Mask,
        false => AlphaMode::Composite,
    };
    options.alpha.unwrap_or(usual)
}

/// Drops points that are not finite, with a warning that counts them and names `path`.
pub fn keep_finite(path: &Path, points: &mut Vec<Point>, warnings: &mut Vec<String>) {
    let count = points.len();
    points.retain(Point::is_finite);
    if points.len() < count {
        warnings.push(format!(
            "{}: {} of {count} points are not finite and were dropped",
            path.display(),
            count - points.len()
        ));
    }
}

/// Drops points that are not finite from the lists of points seen, and counts the others anew. Lists that are all empty
/// become none.
fn keep_finite_seen(points: &[Point], seen: &mut Vec<Vec<u32>>) {
    let mut next = 0..;
    let place = |point: &Point| if point.is_finite() { next.next() } else { None };
    let places: Vec<Option<u32>> = points.iter().map(place).collect();
    for list in seen.iter_mut() {
        *list = list.iter().filter_map(|&old| places[old as usize]).collect();
    }
    if seen.iter().all(Vec::is_empty) {
        seen.clear();
    }
}

/// Drops points outside a side from the list of the points that its photograph sees.
fn keep_seen_by_sides(views: &[View], points: &[Point], seen: &mut [Vec<u32>]) {
    for (view, list) in views.iter().zip(seen).filter(|(view, _)| view.is_side()) {
        list.retain(|&point| view.camera.sees(points[point as usize].position.into()));
    }
}

/// Warns of points outside every view: a different coordinate system is a common mistake of conversions, and training
/// from such points fails silently.
fn warn_if_unseen(path: &Path, views: &[View], points: &[Point], warnings: &mut Vec<String>) {
    let step = points.len().div_ceil(1000).max(1);
    let seen = points.iter().step_by(step).any(|point| {
        let point = DVec3::from(point.position);
        views.iter().any(|view| {
            let size = DVec3::new(view.camera.width.into(), view.camera.height.into(), 0.0);
            let pixel = view.camera.pixel_from_world(point);
            pixel.is_some_and(|p| p.cmpge(glam::DVec2::ZERO).all() && p.cmplt(size.truncate()).all())
        })
    });
    if !seen && !points.is_empty() {
        warnings.push(format!(
            "{}: no view sees any of the points; are they in the cameras' coordinate system?",
            path.display()
        ));
    }
}
