//! The scene on the CPU: splats, cameras, data sets.
//!
//! World and camera axes are COLMAP's: x right, y down, z forward (camera); pixel centres lie at +0.5.
//!
//! **Invariant:** no Vulkan, and no file access.

#[cfg(feature = "train")]
mod alignment;
mod axes;
mod camera;
mod dataset;
mod eigen;
mod focus;
mod harmonics;
mod kd;
#[cfg(feature = "train")]
mod keyframes;
mod lens;
mod mesh;
mod morton;
mod similarity;
mod splats;
mod tone;
mod vignetting;

#[cfg(feature = "train")]
pub use alignment::PoseDifference;
pub use axes::Axes;
pub(crate) use axes::sh_signs;
pub use camera::{Camera, ClipAxes, Projection};
pub use dataset::{AlphaMode, Dataset, MaskFile, Photo, PhotoSource, Point, Split, View};
pub(crate) use eigen::eigen;
pub use focus::{focus, mean_up};
pub(crate) use harmonics::ShRotation;
pub use harmonics::sh_basis;
pub use kd::kd_order;
#[cfg(feature = "train")]
pub use keyframes::cameras_between;
pub use lens::{Distortion, Lens, Optics};
pub use mesh::Mesh;
pub use morton::morton_order;
pub use similarity::Similarity;
#[cfg(feature = "train")]
pub(crate) use splats::logit;
pub(crate) use splats::sigmoid;
pub use splats::{NotFinite, Primitive, SH_C0, ScreenFilter, Splats, sh_coefficient_count};
pub use tone::{CURVE_OFFSET, CURVE_POWER, linear_to_srgb, srgb_to_linear, stops};
pub use vignetting::Vignetting;
