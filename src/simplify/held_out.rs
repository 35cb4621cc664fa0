//! Held-out views: training views that are kept from training until the splat count is decided. Test views are never
//! among them.

use crate::Result;
use crate::render::Evaluator;
use crate::scene::{Dataset, Splats, Split};
use crate::stats::mean;

/// Smallest number of held-out views, where there are enough views: a spread needs as many.
const VIEWS_MIN: usize = 3;

/// Training views for each held-out one, as are usually kept for tests.
const VIEWS_EACH: usize = 8;

/// Smallest mean squared error that counts: that of a hundredth of white, about the least contrast that an eye tells
/// (Weber). Without it a plain wall would be given splats for invisible decibels beyond 40.
pub(super) const UNSEEN: f64 = 1e-4;

/// PSNR at that error: a view cannot score higher.
pub(super) const FULL_DB: f64 = 40.0;

/// Whether no view has a visible error.
pub(super) fn is_full(psnr_db: &[f64]) -> bool {
    psnr_db.iter().all(|&psnr| psnr >= FULL_DB)
}

/// Mean distance of the views from a PSNR without visible error, decibels.
pub(super) fn short_of_full(psnr_db: &[f64]) -> f64 {
    let short: Vec<f64> = psnr_db.iter().map(|psnr| FULL_DB - psnr).collect();
    mean(&short)
}

/// Indices of the training views: those trained on, and the held-out ones, which lie evenly among them. With fewer than
/// eight views none is held out, and both lists are all views.
pub fn split_views(dataset: &Dataset) -> (Vec<usize>, Vec<usize>) {
    let views = dataset.split(Split::Train);
    let count = (views.len().div_ceil(VIEWS_EACH)).max(VIEWS_MIN);
    if views.len() < 2 * VIEWS_MIN + 2 {
        return (views.clone(), views);
    }
    // Middles of equal ranges: neighbours on both sides are trained on.
    let place = |k: usize| (2 * k + 1) * views.len() / (2 * count);
    let held_out: Vec<usize> = (0..count).map(|k| views[place(k)]).collect();
    let others = views.iter().copied().filter(|v| !held_out.contains(v));
    (others.collect(), held_out)
}

/// PSNR of each of the evaluator's views, decibels, at most `most`; 0 where the rendering is not finite.
pub(super) fn psnr_db(
    evaluator: &mut Evaluator<'_>,
    splats: &Splats,
    most: f64,
) -> Result<Vec<f64>> {
    let errors = evaluator.mean_squared_errors(splats)?;
    let psnr = |error: f64| match error.is_finite() {
        true => (-10.0 * error.max(f64::MIN_POSITIVE).log10()).min(most),
        false => 0.0,
    };
    Ok(errors.into_iter().map(psnr).collect())
}
