//! Merging of neighbouring splats without training, at the least error of the pictures.
//!
//! Two splats cover 1 − (1 − α G) (1 − α′ G′) = α G + α′ G′ − α α′ G G′: a mixture of three Gaussians, the last of
//! which, their overlap, counts negative. Each has the mass m = opacity × mean projected area, the light that it covers
//! as a mean over all directions. The merged splat has the mixture's mass, mean and covariance,
//!
//! m = Σ mₖ,  μ = Σ mₖ μₖ / m,  Σ = Σ mₖ (Σₖ + δₖ δₖᵀ) / m,  δₖ = μₖ − μ,
//!
//! the opacity for that mass (if that exceeds the maximum, the splat is enlarged instead), and the mean of the SH
//! coefficients by mass. Projected areas include the screen's dilation of small splats, in the view that sees them
//! largest. In mip mode, in which the screen adds no light, masses are those of the splats alone.
//!
//! The cheapest pair among near neighbours merges, the merged splat gets costs with its parts' neighbours, and so on;
//! neighbours are searched again whenever a quarter of the splats has gone. The cost, `cost::cost`, ignores occlusion
//! by other splats, so that merging has no proven bound: [`difference`] measures its effect on pictures.
//!
//! **Invariant:** the same splats and rates give the same bits at any number of threads.

mod cost;
mod difference;
mod greedy;
mod joint;
mod mass;
mod projection;
mod shadow;

pub use difference::{Difference, difference};

use crate::scene::{Camera, Splats};
use crate::train::smoothing::sampling_rates;
use greedy::MergeState;

/// Margin beyond the image's border, as a share of its size, within which a splat counts as seen; as for the mip
/// filter.
const MARGIN: f64 = 0.15;

/// Result of [`merge`].
#[derive(Clone, Debug, PartialEq)]
pub struct MergeResult {
    /// Remaining splats in their order; unmerged ones are bit-identical.
    pub splats: Splats,
    /// Number of splats removed.
    pub gone: usize,
}

/// Pixels per world unit at each splat, in the view that sees it largest; for unseen splats the smallest of all rates.
/// `near` is the near plane, world units.
pub fn rates(splats: &Splats, cameras: &[Camera], near: f64) -> Vec<f64> {
    let rates = sampling_rates(&splats.mean, cameras, near, MARGIN);
    let lowest = rates.iter().copied().flatten().reduce(f64::min);
    let rate = |rate: Option<f64>| rate.or(lowest).unwrap_or(1.0);
    rates.into_iter().map(rate).collect()
}

/// Merges neighbours until `share` of the splats is gone (0 to 1), or no pair is left. `rates` are those of [`rates`].
/// Splats with a value that is not finite, a rate that is not positive, or without shape or mass are left alone. `each`
/// is called with the number gone so far; `None` if it returns false.
pub fn merge(splats: &Splats, rates: &[f64], share: f64, each: &mut dyn FnMut(usize) -> bool) -> Option<MergeResult> {
    assert_eq!(splats.len(), rates.len(), "a rate for every splat");
    let count = (share.clamp(0.0, 1.0) * splats.len() as f64).floor() as usize;
    let mut merging = MergeState::new(splats, rates);
    let gone = merging.run(count, each)?;
    Some(MergeResult {
        splats: merging.splats(),
        gone,
    })
}
