//! Meshes of scenes: alignment of depth maps, their fusion in a volume of signed distances, extraction, cleaning,
//! distances from a true mesh, pictures, and errors of depths and normals.
//!
//! **Invariant:** no device and no files; the same maps give the same bytes.
//!
#![doc = include_str!("../../docs/surfaces.md")]

mod align;
mod clean;
mod compare;
mod cubes;
mod depth_map;
mod depth_maps;
mod draw;
mod extract;
mod fit_colors;
mod flood_fill;
mod fuse;
mod sampler;
mod score;
mod smooth;
mod tree;
mod volume;

pub use clean::{MeshComponent, clean, components};
pub use compare::{ComparisonOptions, DistanceSummary, MeshComparison, NormalSummary, ThresholdScore, compare};
pub use depth_map::DepthMap;
pub use depth_maps::DepthMaps;
pub use draw::{MeshPicture, draw};
pub use fit_colors::{ColorFitOptions, fit_colors};
pub use fuse::{FusionOptions, FusionPhase, FusionReport, fuse};
pub use score::{SurfaceImage, SurfaceScore};
