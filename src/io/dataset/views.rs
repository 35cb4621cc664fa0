//! Check of listed views against their photographs.

use super::super::listing::ListedView;
use super::super::parallel::try_map;
use super::super::photo::{self, SIDE_MIN};
use super::{MaskUse, OpenOptions, faces};
use crate::error::{Error, Result};
use crate::scene::{Camera, MaskFile, Optics, PhotoSource, View};
use rayon::prelude::*;
use std::path::Path;

/// A photograph with its size checked.
struct CheckedPhoto {
    /// Its views: one, or the sides of a wide photograph.
    views: Vec<View>,
    /// Size of the file if it differs from the camera's.
    file_size: Option<(u32, u32)>,
    /// True if the orientation in EXIF data is applied.
    is_turned: bool,
    warning: Option<String>,
}

/// Views that have passed the checks.
#[derive(Default)]
pub(super) struct CheckedViews {
    pub(super) views: Vec<View>,
    /// Indices of the views held out by the reconstruction itself, or of the sides of photographs that are held out.
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
    let found = try_map(listed.par_iter(), |view| look_at_photo(view, options))?;
    let mut checked = CheckedViews::default();
    let seen_from_listed: Vec<Vec<u32>> = listed.iter_mut().map(|view| std::mem::take(&mut view.seen)).collect();
    let (mut missing, mut resized, mut turned) = (Vec::new(), Vec::new(), Vec::new());
    // Indices of the first view of each photograph.
    let mut firsts = Vec::new();
    for ((listed, found), points) in listed.iter().zip(found).zip(seen_from_listed) {
        let Some(found) = found else {
            missing.push(&listed.photo);
            continue;
        };
        firsts.push(checked.views.len());
        if listed.held_out {
            checked.held_out.push(checked.views.len());
        }
        resized.extend(found.file_size.map(|size| (listed, size)));
        turned.extend(found.is_turned.then_some(&listed.photo));
        warnings.extend(found.warning);
        checked.seen.extend(vec![points; found.views.len()]);
        checked.views.extend(found.views);
    }
    let is_split = checked.views.len() > firsts.len();
    if is_split {
        hold_out_whole_photos(&mut checked, &firsts, options.test_every);
        let (photos, views) = (firsts.len(), checked.views.len());
        let what = format!("{photos} wide photographs are seen as {views} pinhole pictures");
        warnings.push(format!("{}: {what}", path.display()));
    }
    if let Some(first) = missing.first() {
        let what = format!(
            "{} of {} photographs are missing, the first is {}",
            missing.len(),
            listed.len(),
            first.display()
        );
        if checked.views.is_empty() {
            return Err(Error::file(path, what));
        }
        warnings.push(format!("{}: {what}; their views are left out", path.display()));
    }
    warn_of_sizes(path, &resized, listed.len(), warnings);
    if let Some(first) = turned.first() {
        warnings.push(format!(
            "{}: {} of {} photographs are turned as their EXIF data ask, because their cameras have the exchanged \
             width and height (the first is {})",
            path.display(),
            turned.len(),
            listed.len(),
            first.display()
        ));
    }
    Ok(checked)
}

/// Holds out all sides of every `test_every`-th photograph, so that no test pixel is trained on.
fn hold_out_whole_photos(checked: &mut CheckedViews, firsts: &[usize], test_every: usize) {
    let by_itself = std::mem::take(&mut checked.held_out);
    let ends = firsts.iter().skip(1).copied().chain([checked.views.len()]);
    for (ordinal, (first, end)) in firsts.iter().zip(ends).enumerate() {
        let is_test = match by_itself.is_empty() {
            true => test_every > 0 && ordinal.is_multiple_of(test_every),
            false => by_itself.contains(first),
        };
        if is_test {
            checked.held_out.extend(*first..end);
        }
    }
}

fn warn_of_sizes(path: &Path, resized: &[(&ListedView, (u32, u32))], all: usize, warnings: &mut Vec<String>) {
    let Some((first, size)) = resized.first() else {
        return;
    };
    warnings.push(format!(
        "{}: {} of {all} photographs have another size than their camera (the first is {}: {} x {}, \
         camera {} x {}); the intrinsics were scaled",
        path.display(),
        resized.len(),
        first.photo.display(),
        size.0,
        size.1,
        first.camera.width,
        first.camera.height
    ));
}

/// `None` if the photograph is required but missing.
fn look_at_photo(listed: &ListedView, options: &OpenOptions) -> Result<Option<CheckedPhoto>> {
    let mut checked = CheckedPhoto {
        views: Vec::new(),
        file_size: None,
        is_turned: false,
        warning: None,
    };
    let mut camera = listed.camera;
    let mut source = PhotoSource::Absent;
    if listed.photo.is_file() {
        match fitting_size(listed) {
            Ok((size, orientation)) => {
                if size != (camera.width, camera.height) {
                    camera = camera.resized(size.0, size.1);
                    checked.file_size = Some(size);
                }
                checked.is_turned = orientation > 4;
                source = PhotoSource::File {
                    path: listed.photo.clone(),
                    optics: listed.lens.map(|lens| Box::new(Optics::of(lens, &camera))),
                    orientation,
                    mask: mask(listed, options.masks),
                    vignetting: None,
                };
            }
            Err(error) if options.photos_required => return Err(error),
            Err(error) => checked.warning = Some(format!("{error}; the view is kept without it")),
        }
    } else if options.photos_required {
        return Ok(None);
    }
    for (name, camera, photo) in sides(listed, camera, source)? {
        let camera = reduced(listed, camera, options.downscale)?;
        checked.views.push(View { name, camera, photo });
    }
    Ok(Some(checked))
}

/// The view of a photograph, or those of its sides.
fn sides(listed: &ListedView, camera: Camera, source: PhotoSource) -> Result<Vec<(String, Camera, PhotoSource)>> {
    let PhotoSource::File {
        optics: Some(optics), ..
    } = &source
    else {
        return Ok(vec![(listed.name.clone(), camera, source)]);
    };
    let sides = faces::split(optics);
    let is_empty = sides
        .as_ref()
        .map_or_else(|| faces::shows_nothing(optics), Vec::is_empty);
    if is_empty {
        let what = "shows nothing through the lens of its camera";
        return Err(Error::file(&listed.photo, what));
    }
    let Some(sides) = sides else {
        return Ok(vec![(listed.name.clone(), camera, source)]);
    };
    let side = |(name, side): (&str, Optics)| {
        let posed = Camera {
            rotation: side.lens_from_pinhole.transpose() * camera.rotation,
            position: camera.position,
            ..side.pinhole
        };
        let mut photo = source.clone();
        if let PhotoSource::File { optics, .. } = &mut photo {
            *optics = Some(Box::new(side));
        }
        (format!("{}#{name}", listed.name), posed, photo)
    };
    Ok(sides.into_iter().map(side).collect())
}

fn reduced(listed: &ListedView, camera: Camera, downscale: u32) -> Result<Camera> {
    if downscale == 1 {
        return Ok(camera);
    }
    let side = |side: u32| (f64::from(side) / f64::from(downscale)).round() as u32;
    let (width, height) = (side(camera.width), side(camera.height));
    if width.min(height) < SIDE_MIN {
        let what = format!(
            "reduced by {downscale} it would have {width} x {height} pixels; at least {SIDE_MIN} x \
             {SIDE_MIN} are needed"
        );
        return Err(Error::file(&listed.photo, what));
    }
    Ok(camera.resized(width, height))
}

fn mask(listed: &ListedView, usage: MaskUse) -> Option<MaskFile> {
    let path = listed.mask.clone().filter(|_| usage != MaskUse::Off)?;
    Some(MaskFile {
        path,
        inverted: usage == MaskUse::Inverted,
    })
}

/// Size of the file as its camera sees it, and the orientation that is applied for it, else 1: stored pixels where they
/// fit, exchanged sides where only the EXIF orientation makes them fit.
fn fitting_size(listed: &ListedView) -> Result<((u32, u32), u8)> {
    let size = photo::dimensions(&listed.photo)?;
    let camera = (listed.camera.width, listed.camera.height);
    if photo::same_aspect(size, camera) {
        return Ok((size, 1));
    }
    let exchanged = (size.1, size.0);
    if photo::same_aspect(exchanged, camera) {
        let orientation = photo::tags(&listed.photo)?.orientation;
        if (5..=8).contains(&orientation) {
            return Ok((exchanged, orientation));
        }
    }
    Err(photo::wrong_aspect(&listed.photo, size, camera))
}
