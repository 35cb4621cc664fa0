//! No more than a scene needs: what can go from a scene at an error that is proven, and the proof's check.
//!
//! With C = Σ cᵢ wᵢ + T · background, wᵢ = αᵢ Tᵢ, and Bᵢ what is seen through splat i, leaving splat i out changes a
//! pixel by wᵢ (Bᵢ − cᵢ). Take the splats of a set S out one after the other, the farthest first: each leaves the
//! transmittance before those nearer than it alone, so that each is taken out at the weight that it has in the whole
//! picture, and Bᵢ, a mixture of colours that are left and the background, lies within their range. So
//!
//! |ΔC| ≤ Σ_S wᵢ · range, with the weights of the whole picture,
//!
//! channel by channel, where the range is that of the channel over the pixel's splats and the background (harmonics may
//! leave 0 to 1). A pixel that ended early, with T < t left of the light, may show more of what lies behind it once
//! something is gone; as if that had been added first, which costs T · range, and S been taken out then. In all
//!
//! |ΔC| ≤ (Σ_S wᵢ + T \[T < t\]) · range, and rounding.
//!
//! Colours that are off by δ at most, as [`reduce_harmonics`] leaves them, move a pixel by δ at most, since the weights
//! sum to no more than 1; and widen its range by 2 δ.
//!
//! [`prune`] finds a set whose weights sum to no more than a budget at every pixel of every view it is given, and
//! [`measure`] holds the pictures against what this promises, pixel by pixel. That no set could be larger is not
//! claimed: this is a packing problem with a constraint a pixel, and those are hard. It is claimed that nothing is left
//! that could be added.
//!
//! **Invariant:** the same scene, views and budget give the same set on the same device.
//!
#![doc = include_str!("../../docs/simplify.md")]

mod auto;
mod change;
mod contribution;
mod decision;
mod detail;
pub mod gain;
mod held_out;
mod history;
mod law;
mod merge;
mod prune;
mod refit;
mod sh_error;
mod sh_fit;

pub use auto::{AutoRun, CountController, for_auto_count};
pub use change::{Change, Promise, measure};
pub use contribution::{
    ContributionPass, PassOptions, PixelErrors, RemovalError, RenderedTiles, SplatContribution,
};
pub use decision::{Decision, HalfResolution};
pub use held_out::split_views;
pub use history::{Act, Entry, History, Phase, Round};
pub use law::Law;
pub use merge::{Difference, Merged, difference, merge, rates};
pub use prune::{Pruned, kept, prune};
pub use refit::refit_config;
pub use sh_error::{Reduced, reduce_harmonics};
pub use sh_fit::{Fits, Seen};
