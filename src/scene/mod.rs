//! The scene on the CPU: splats, cameras, data sets. No Vulkan, no files.
//!
//! World and camera axes are COLMAP's: x right, y down, z forward (camera); pixel centres lie at +0.5.
//!
//! **Invariant:** nothing here knows of a device or reads a file.

mod camera;
mod dataset;
mod focus;
mod mesh;
mod splats;

pub use camera::Camera;
pub use dataset::{AlphaMode, Dataset, Distortion, Photo, PhotoSource, Point, Split, View};
pub use focus::focus;
pub use mesh::Mesh;
pub use splats::{NotFinite, RenderMode, SH_C0, Splats, sh_coefficient_count};
