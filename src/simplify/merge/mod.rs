//! Fewer splats without training: neighbours merge where one Gaussian stands for two at the least error of pictures.
//!
//! Two splats cover 1 − (1 − α G) (1 − α′ G′) = α G + α′ G′ − α α′ G G′: a mixture of three Gaussians, the last of
//! which, what they have in common, counts against the others. Each has the mass m = opacity × mean shadow, the light
//! that it covers as a mean over all directions. The merged splat has the mixture's mass, mean and covariance,
//!
//! m = Σ mₖ,  μ = Σ mₖ μₖ / m,  Σ = Σ mₖ (Σₖ + δₖ δₖᵀ) / m,  δₖ = μₖ − μ,
//!
//! the opacity that gives it that mass (where that is more than opaque, it is larger instead), and the mean of the
//! harmonics by mass. Shadows are those that pictures have: what a screen adds to small splats counts, as in the view
//! that sees them largest. In mip mode, where the screen adds no light, masses are those of the splats alone.
//!
//! The cheapest pair among near neighbours merges, what it has become is priced with its parts' neighbours, and so on;
//! neighbours are looked for anew whenever a quarter of the splats has gone. The price is `cost::cost`. It knows
//! nothing of what else hides a splat, so that no bound of what merging does to a picture follows: [`difference`]
//! measures it.
//!
//! **Invariant:** the same splats and rates give the same bits, whatever the number of threads.

mod axes;
mod cost;
mod difference;
mod greedy;
mod joint;
mod mass;
mod neighbors;
mod projection;

pub use difference::{Difference, difference};

use crate::scene::{Camera, Splats};
use crate::train::smoothing::sampling_rates;
use greedy::Merging;

/// How far beyond the image's border a splat is still seen, as a share of the image's size: as for the mip filter.
const MARGIN: f64 = 0.15;

/// What has become of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// What is there, in its old order: splats that did not merge are as they were, to the bit.
    pub splats: Splats,
    /// How many splats went.
    pub gone: usize,
}

/// How many pixels a world unit has at each splat, in the view that sees it largest; where none does, as where it is
/// seen smallest. `near` is the near plane, world units.
pub fn rates(splats: &Splats, cameras: &[Camera], near: f64) -> Vec<f64> {
    let rates = sampling_rates(&splats.mean, cameras, near, MARGIN);
    let lowest = rates.iter().copied().flatten().reduce(f64::min);
    let rate = |rate: Option<f64>| rate.or(lowest).unwrap_or(1.0);
    rates.into_iter().map(rate).collect()
}

/// Merges neighbours until `share` of the splats is gone (0 to 1), or no pair is left. `rates` are those of [`rates`];
/// a splat whose rate is no positive number, which has a number that is not finite, or neither shape nor mass, is left
/// alone. `each` hears now and then how many have gone; `None` where it says no.
pub fn merge(
    splats: &Splats,
    rates: &[f64],
    share: f64,
    each: &mut dyn FnMut(usize) -> bool,
) -> Option<Merged> {
    assert_eq!(splats.len(), rates.len(), "a rate for every splat");
    let count = (share.clamp(0.0, 1.0) * splats.len() as f64).floor() as usize;
    let mut merging = Merging::new(splats, rates);
    let gone = merging.run(count, each)?;
    Some(Merged {
        splats: merging.splats(),
        gone,
    })
}
