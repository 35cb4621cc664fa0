//! Check of listed views against their photographs.

use super::super::listing::ListedView;
use super::super::photo::{self, SIDE_MIN};
use super::OpenOptions;
use crate::error::{Error, Result};
use crate::scene::{PhotoSource, View};
use rayon::prelude::*;
use std::path::Path;

/// A view with its photograph's size checked.
struct CheckedView {
    view: View,
    /// Size of the file if it differs from the camera's.
    file_size: Option<(u32, u32)>,
    warning: Option<String>,
}

/// Views that have passed the checks.
#[derive(Default)]
pub(super) struct CheckedViews {
    pub(super) views: Vec<View>,
    /// Indices of the views held out by the reconstruction itself.
    pub(super) held_out: Vec<usize>,
    /// Indices of the points that each view sees.
    pub(super) seen: Vec<Vec<u32>>,
}

/// Checks the photographs in parallel.
pub(super) fn look_at_photos(
    path: &Path,
    mut listed: Vec<ListedView>,
    options: &OpenOptions,
    warnings: &mut Vec<String>,
) -> Result<CheckedViews> {
    let found: Vec<Option<CheckedView>> = listed
        .par_iter()
        .map(|view| look_at_photo(view, options))
        .collect::<Result<_>>()?;
    let mut checked = CheckedViews::default();
    let CheckedViews { views, held_out, seen } = &mut checked;
    let seen_from_listed: Vec<Vec<u32>> = listed.iter_mut().map(|view| std::mem::take(&mut view.seen)).collect();
    let (mut missing, mut resized) = (Vec::new(), Vec::new());
    for ((listed, found), points) in listed.iter().zip(found).zip(seen_from_listed) {
        let Some(found) = found else {
            missing.push(&listed.photo);
            continue;
        };
        if listed.held_out {
            held_out.push(views.len());
        }
        resized.extend(found.file_size.map(|size| (listed, size)));
        warnings.extend(found.warning);
        views.push(found.view);
        seen.push(points);
    }
    if let Some(first) = missing.first() {
        let what = format!(
            "{} of {} photographs are missing, the first is {}",
            missing.len(),
            listed.len(),
            first.display()
        );
        if views.is_empty() {
            return Err(Error::file(path, what));
        }
        warnings.push(format!("{}: {what}; their views are left out", path.display()));
    }
    if let Some((first, size)) = resized.first() {
        warnings.push(format!(
            "{}: {} of {} photographs have another size than their camera (the first is {}: {} x {}, \
             camera {} x {}); the intrinsics were scaled",
            path.display(),
            resized.len(),
            listed.len(),
            first.photo.display(),
            size.0,
            size.1,
            first.camera.width,
            first.camera.height
        ));
    }
    Ok(checked)
}

/// `None` if the photograph is required but missing.
fn look_at_photo(listed: &ListedView, options: &OpenOptions) -> Result<Option<CheckedView>> {
    let mut camera = listed.camera;
    let mut source = PhotoSource::Absent;
    let (mut file_size, mut warning) = (None, None);
    if listed.photo.is_file() {
        match fitting_size(listed) {
            Ok(size) => {
                if size != (camera.width, camera.height) {
                    camera = camera.resized(size.0, size.1);
                    file_size = Some(size);
                }
                source = PhotoSource::File {
                    path: listed.photo.clone(),
                    distortion: listed.distortion,
                };
            }
            Err(error) if options.photos_required => return Err(error),
            Err(error) => warning = Some(format!("{error}; the view is kept without it")),
        }
    } else if options.photos_required {
        return Ok(None);
    }
    if options.downscale > 1 {
        let reduced = |side: u32| (f64::from(side) / f64::from(options.downscale)).round() as u32;
        let (width, height) = (reduced(camera.width), reduced(camera.height));
        if width.min(height) < SIDE_MIN {
            let what = format!(
                "reduced by {} it would have {width} x {height} pixels; at least {SIDE_MIN} x \
                 {SIDE_MIN} are needed",
                options.downscale
            );
            return Err(Error::file(&listed.photo, what));
        }
        camera = camera.resized(width, height);
    }
    let view = View {
        name: listed.name.clone(),
        camera,
        photo: source,
    };
    Ok(Some(CheckedView {
        view,
        file_size,
        warning,
    }))
}

/// Size of the file; an error if its aspect ratio is not the camera's.
fn fitting_size(listed: &ListedView) -> Result<(u32, u32)> {
    let size = photo::dimensions(&listed.photo)?;
    let camera = (listed.camera.width, listed.camera.height);
    if photo::same_aspect(size, camera) {
        Ok(size)
    } else {
        Err(photo::wrong_aspect(&listed.photo, size, camera))
    }
}
