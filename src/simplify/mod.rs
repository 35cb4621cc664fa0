//! Simplification: reduction of a scene's splats and SH within a proven error, and the measured check of the bound.
//!
//! With C = Σ cᵢ wᵢ + T · background, wᵢ = αᵢ Tᵢ, and Bᵢ the colour seen through splat i, removing splat i changes a
//! pixel by wᵢ (Bᵢ − cᵢ). Remove the splats of a set S one after the other, the farthest first: each leaves the
//! transmittance before nearer splats unchanged, so that each is removed at its weight in the full picture, and Bᵢ, a
//! mixture of remaining colours and the background, lies within their range. So
//!
//! |ΔC| ≤ Σ_S wᵢ · range, with the weights of the full picture,
//!
//! channel by channel, where the range is that of the channel over the pixel's splats and the background (SH colours
//! may leave 0 to 1). A ray that ended early, with transmittance T < t, may reach farther splats after a removal; as if
//! those had been added first, at a cost of T · range, and S been removed then. In total
//!
//! |ΔC| ≤ (Σ_S wᵢ + T \[T < t\]) · range, and rounding.
//!
//! Colour errors of at most δ, as from [`reduce_harmonics`], move a pixel by at most δ, since the weights sum to no
//! more than 1, and widen its range by 2 δ.
//!
//! [`prune`] finds a set with summed weights within a budget at every pixel of every given view, and [`measure`]
//! compares the pictures with the bound at every pixel. The set is not the largest possible, which is a hard packing
//! problem with one constraint per pixel, but no splat can be added to it.
//!
//! **Invariant:** the same scene, views and budget give the same set on the same device.
//!
#![doc = include_str!("../../docs/simplify.md")]

mod auto;
mod change;
mod contribution;
mod decision;
mod held_out;
mod history;
mod loss;
mod merge;
mod prune;
mod refit;
mod sh_error;
mod sh_fit;

pub use auto::{AutoRun, CountController, controller_needs, for_auto_count};
pub use change::{MeasuredChange, Promise, measure};
pub use contribution::{ContributionPass, PassOptions, RemovalError, RenderedTiles, SplatContribution};
pub use decision::{Decision, LossPoint, loss_at};
pub use held_out::split_views;
pub use history::{Act, History, HistoryEntry, Phase, ReducedScene, Round};
pub use loss::{Estimate, Estimates, Measure, QualityLoss, ViewScores, ViewSet};
pub use merge::{Difference, MergeResult, difference, merge, rates};
pub use prune::{PruneResult, kept, prune};
pub use refit::refit_config;
pub use sh_error::{ShReduction, reduce_harmonics};
pub(crate) use sh_fit::factorize;
pub use sh_fit::{Fits, ViewWeights};
