//! Poses of the training photographs, refined along with the splats.
//!
//! A pose is the given one, turned about its centre and shifted. Each step leaves the force on all splats and their
//! torque about the camera (kernel `pose_gradient`); after each epoch every photograph takes a step of Adam along the
//! axes in which its picture moves independently (`modes`).
//!
//! **Invariant:** the similarity that brings the given poses of the training views nearest to the refined ones is the
//! identity, so that the scene stays in the coordinates of the data set.

mod modes;
mod refinement;

pub use refinement::{PoseState, RefinedPoses, photo_name};
