//! Warnings of masks and of colour profiles, the usual mistakes among them.

use super::super::parallel::try_map;
use super::super::photo;
use super::{MaskUse, OpenOptions};
use crate::error::Result;
use crate::scene::{AlphaMode, MaskFile, PhotoSource, View};
use rayon::prelude::*;
use std::path::Path;

/// Masks that are looked at, evenly spaced.
const LOOKED_AT: usize = 8;

/// Share of left-out pixels from which masks are probably meant the other way round.
const INVERTED_FROM: f64 = 0.6;

/// Whether photographs have masks that count; warns of masks that leave most out, of photographs without, and of a
/// folder of masks that belong to none.
pub(super) fn look_at_masks(
    path: &Path,
    views: &[View],
    options: &OpenOptions,
    warnings: &mut Vec<String>,
) -> Result<bool> {
    let mask = |view: &View| match &view.photo {
        PhotoSource::File { mask, .. } => mask.clone(),
        _ => None,
    };
    let masks: Vec<MaskFile> = views.iter().filter_map(mask).collect();
    let place = path.display();
    if masks.is_empty() {
        if options.masks != MaskUse::Off && options.photos_required && path.join("masks").is_dir() {
            warnings.push(format!(
                "{place}: the folder masks has no mask of any photograph (NAME.jpg.png or NAME.png is expected)"
            ));
        }
        return Ok(false);
    }
    if options.alpha == Some(AlphaMode::Composite) {
        warnings.push(format!(
            "{place}: masked pixels become background, because alpha is to be composited"
        ));
    }
    if masks.len() < views.len() {
        let (some, all) = (masks.len(), views.len());
        warnings.push(format!("{place}: {some} of {all} photographs have masks"));
    }
    let sample: Vec<&MaskFile> = masks.iter().step_by(masks.len().div_ceil(LOOKED_AT)).collect();
    let shares = try_map(sample.par_iter(), |mask| photo::share_left_out(mask))?;
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    if mean > INVERTED_FROM {
        warnings.push(format!(
            "{place}: masks leave out {:.0} % of the photographs; if black should keep, use --masks inverted",
            100.0 * mean
        ));
    }
    Ok(true)
}

/// Warns once of a colour profile other than sRGB, judged by the first photograph.
pub(super) fn look_at_profile(path: &Path, views: &[View], warnings: &mut Vec<String>) {
    let first = views.iter().find_map(|view| match &view.photo {
        PhotoSource::File { path, .. } => Some(path),
        _ => None,
    });
    let profile = first.and_then(|file| photo::tags(file).ok()?.profile);
    if let Some(profile) = profile {
        warnings.push(format!(
            "{}: photographs have the colour profile {profile}; their values are used as stored, as if they were sRGB",
            path.display()
        ));
    }
}
