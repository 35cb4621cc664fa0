//! Poses of the training photographs, refined along with the splats.
//!
//! A pose is the given one, turned about its centre and shifted. In a few rounds of a run (`adjustment`) the scene is
//! drawn in each view, points of its surfaces are searched in the photographs (`tracks`, `windows`), and the motions of
//! all cameras that explain their places are taken (`bundle`). Between rounds the splats follow.
//!
//! **Invariant:** the similarity that brings the given poses of the training views nearest to the refined ones is the
//! identity, so that the scene stays in the coordinates of the data set.

mod adjustment;
mod bundle;
mod refinement;
mod resection;
mod tracks;
mod windows;

pub use adjustment::PoseAdjustment;
pub(super) use adjustment::drawn_size;
pub use refinement::{PoseState, RefinedPoses, photo_name};
