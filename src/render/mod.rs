//! Rendering of frames: splats on the device, a camera, an image.
//!
//! [`Forward`] is the kernel sequence shared with training; [`Renderer`] is the users' interface.
//!
//! **Invariant:** `Renderer::record` never submits, waits, reads this frame back, or allocates once warm.
//!
#![doc = include_str!("../../docs/rendering.md")]

mod accuracy;
#[cfg_attr(not(feature = "train"), allow(dead_code, reason = "for gradients"))]
mod band_replay;
mod blocks;
mod capacity;
mod compatibility;
mod compositor;
mod depth_bands;
#[cfg(feature = "train")]
mod evaluate;
mod forward;
mod instances;
mod memory;
mod model;
mod occlusion;
mod options;
mod picking;
mod precision;
mod projections;
mod rendered;
mod renderer;
mod row_bands;
mod scratch;
mod slots;
mod statistics;
mod surface;
mod target;
mod upload;
mod view;

pub use crate::kernels::rasterize::{Outputs, SurfelMode};
pub use crate::layout::NO_SPLAT;
pub use accuracy::Accuracy;
#[cfg(feature = "train")]
pub(crate) use band_replay::BandReplay;
pub use blocks::{Block, Blocks};
pub use capacity::Capacity;
pub use compatibility::Compatibility;
pub use depth_bands::{DepthBands, list_limit, loop_turns};
#[cfg(feature = "train")]
pub use evaluate::{Evaluator, ViewEvaluation};
pub use forward::{Forward, tile_stride};
pub use instances::{ClipBox, Instance};
pub(crate) use memory::Allocate;
#[cfg(feature = "train")]
pub(crate) use memory::buffers;
pub use memory::{Need, Purpose, isects_expected, total};
pub use model::{Model, plane_count, planes_from_splats};
pub use occlusion::{DepthCode, HostDepth};
pub use options::{RenderOptions, SplatOrder};
pub use picking::{PickPixel, PickReport, locate};
pub use precision::Precision;
#[cfg(feature = "train")]
pub(crate) use projections::ModelKernels;
pub use rendered::RenderedImage;
pub use renderer::Renderer;
pub use row_bands::{RowBand, RowBands, binding_limit};
pub use scratch::Scratch;
#[cfg(feature = "lab")]
pub(crate) use scratch::{DEPTH_SORT, tile_sort};
pub use slots::{ByDegree, DEGREES, Slots, apart, degrees_used, merge_degrees, of_degree};
pub use statistics::Stats;
pub use surface::Surface;
pub use target::{Blend, DepthKind, HostTarget, PICK_PIXELS_MAX, PickArea};
pub use upload::ModelUpload;
pub use view::{ViewOptions, view_of};
