//! Vignetting of lenses, from the tracks of the sparse points: the same points lie here in the middle of a photograph
//! and there in a corner.
//!
//! Fitted to green with the exposures of the photographs. A point seen from directions that differ by more than about
//! 20° counts as several, for surfaces that shine are brighter at a grazing angle, and floors have it near the border.
//! Photographs of one width and height count as those of one lens. The sides of a wide photograph have no vignetting of
//! their own.

use super::colors::{PatchColor, PhotoColors, TrackColors, lens_size};
use super::fit::{FitSize, TrackFit};
use super::stops;
use crate::error::{Error, Result};
use crate::scene::{Dataset, PhotoSource, View, Vignetting};
use std::collections::BTreeMap;

/// Fewest training photographs of a lens.
const PHOTOS_MIN: usize = 20;

/// Cells of directions to a unit.
const DIRECTION_CELLS: f64 = 3.0;

/// Least loss of light in the corners that is removed, stops.
const LOSS_MIN: f64 = 0.1;

/// Least loss in standard errors, which do not know of shine.
const LOSS_ERRORS_MIN: f64 = 5.0;

/// Channel of the fit.
const GREEN: usize = 1;

/// Vignetting of the photographs of one size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensVignetting {
    /// Width and height of the photographs, pixels.
    pub size: [u32; 2],
    /// Number of training photographs.
    pub photos: usize,
    /// The vignetting.
    pub vignetting: Vignetting,
    /// Standard error of its light in the corner, stops.
    pub error_stops: f64,
}

impl LensVignetting {
    /// Whether it is vignetting: light that falls all the way to the corners, by more than chance.
    pub fn is_clear(&self) -> bool {
        let lost = -self.vignetting.corner_stops();
        self.vignetting.falls() && lost >= LOSS_MIN && lost >= LOSS_ERRORS_MIN * self.error_stops
    }
}

/// Vignetting of each lens with at least twenty training photographs, by their size.
pub fn vignetting(colors: &TrackColors) -> Vec<LensVignetting> {
    let mut photos: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for size in colors.photos.iter().filter_map(|photo| photo.lens) {
        *photos.entry(size).or_default() += 1;
    }
    photos.retain(|_, count| *count >= PHOTOS_MIN);
    if photos.is_empty() {
        return Vec::new();
    }
    let sizes: Vec<[u32; 2]> = photos.keys().copied().collect();
    let lens = |photo: &PhotoColors| sizes.binary_search(&photo.lens?).ok();
    // A point counts anew for every direction.
    let mut points: BTreeMap<(usize, [i64; 3]), usize> = BTreeMap::new();
    let point = |patch: &PatchColor| {
        let direction = (DIRECTION_CELLS * patch.direction).round().as_i64vec3().to_array();
        let next = points.len();
        *points.entry((patch.point, direction)).or_insert(next)
    };
    let all = colors.observations(GREEN, lens, point);
    let size = FitSize {
        photos: colors.photos.len(),
        lenses: sizes.len(),
        points: points.len(),
    };
    let fit = TrackFit::of(all, size);
    let of = |(lens, (size, photos))| LensVignetting {
        size,
        photos,
        vignetting: Vignetting {
            coefficients: fit.lenses[lens],
        },
        error_stops: stops(fit.lens_errors[lens]),
    };
    photos.into_iter().enumerate().map(of).collect()
}

/// Finds the vignetting of each lens, and, where it is clear, removes it from all photographs of the lens, those of
/// test views too, when they are loaded.
///
/// # Errors
/// No lens has enough photographs, the points have no tracks, or a photograph cannot be read.
pub fn remove_vignetting(dataset: &mut Dataset) -> Result<Vec<LensVignetting>> {
    let found = vignetting(&TrackColors::read(dataset)?);
    if found.is_empty() {
        let what = format!(
            "vignetting follows from points that a COLMAP model tracks through at least {PHOTOS_MIN} training \
             photographs of one size, which this data set does not have"
        );
        return Err(Error::Config(what));
    }
    for view in &mut dataset.views {
        let size = lens_size(view);
        if let Some(lens) = found.iter().find(|lens| Some(lens.size) == size && lens.is_clear()) {
            remove(view, lens.vignetting);
        }
    }
    Ok(found)
}

fn remove(view: &mut View, of_lens: Vignetting) {
    match &mut view.photo {
        PhotoSource::File { vignetting, .. } => *vignetting = Some(of_lens),
        PhotoSource::Memory(photo) => of_lens.remove(&mut photo.rgba, &view.camera),
        PhotoSource::Absent => {}
    }
}
