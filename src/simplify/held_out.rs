//! Held-out views: training views excluded from training until the splat count is fixed. Test views are never among
//! them.

use crate::scene::{Dataset, Split};
use crate::train::config::AutoConfig;

/// Fewest views that a mean with bounds is taken over.
const LEAST: usize = 3;

/// Indices of the training views: those trained on, and the held-out ones, spread evenly among them. With too few views
/// none is held out, and both lists are all views.
pub fn split_views(dataset: &Dataset, config: &AutoConfig) -> (Vec<usize>, Vec<usize>) {
    let views = dataset.split(Split::Train);
    let count = (views.len().div_ceil(config.held_out_every as usize)).max(LEAST);
    if views.len() < 2 * LEAST + 2 {
        return (views.clone(), views);
    }
    // Middles of equal ranges, so that neighbours on both sides are trained on.
    let place = |k: usize| (2 * k + 1) * views.len() / (2 * count);
    let held_out: Vec<usize> = (0..count).map(|k| views[place(k)]).collect();
    let others = views.iter().copied().filter(|v| !held_out.contains(v));
    (others.collect(), held_out)
}
