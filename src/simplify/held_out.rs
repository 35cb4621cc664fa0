//! Held-out views: training views excluded from training until the splat count is fixed. Test views are never among
//! them.

use crate::Result;
use crate::render::Evaluator;
use crate::scene::{Dataset, Splats, Split};
use crate::stats::mean;
use crate::train::config::AutoConfig;

impl AutoConfig {
    /// Whether every view is without visible error.
    pub(super) fn is_full(&self, psnr_db: &[f64]) -> bool {
        psnr_db.iter().all(|&psnr| psnr >= self.full_db)
    }

    /// Mean shortfall of the views from the PSNR without visible error, decibels.
    pub(super) fn short_of_full(&self, psnr_db: &[f64]) -> f64 {
        let short: Vec<f64> = psnr_db.iter().map(|psnr| self.full_db - psnr).collect();
        mean(&short)
    }
}

/// Indices of the training views: those trained on, and the held-out ones, spread evenly among them. With too few views
/// none is held out, and both lists are all views.
pub fn split_views(dataset: &Dataset, config: &AutoConfig) -> (Vec<usize>, Vec<usize>) {
    let views = dataset.split(Split::Train);
    let least = config.held_out_min as usize;
    let count = (views.len().div_ceil(config.held_out_every as usize)).max(least);
    if views.len() < 2 * least + 2 {
        return (views.clone(), views);
    }
    // Middles of equal ranges, so that neighbours on both sides are trained on.
    let place = |k: usize| (2 * k + 1) * views.len() / (2 * count);
    let held_out: Vec<usize> = (0..count).map(|k| views[place(k)]).collect();
    let others = views.iter().copied().filter(|v| !held_out.contains(v));
    (others.collect(), held_out)
}

/// PSNR of each of the evaluator's views, decibels, at most `most`; 0 if the rendering is not finite.
pub(super) fn psnr_db(evaluator: &mut Evaluator<'_>, splats: &Splats, most: f64) -> Result<Vec<f64>> {
    let errors = evaluator.mean_squared_errors(splats)?;
    let psnr = |error: f64| match error.is_finite() {
        true => (-10.0 * error.max(f64::MIN_POSITIVE).log10()).min(most),
        false => 0.0,
    };
    Ok(errors.into_iter().map(psnr).collect())
}
