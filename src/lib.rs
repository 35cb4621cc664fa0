//! A Vulkan-native 3D Gaussian splatting engine.
//!
#![doc = include_str!("../docs/architecture.md")]
#![deny(missing_docs, unsafe_code)]

#[cfg(feature = "capi")]
pub mod capi;
#[cfg(feature = "cli")]
mod cli;
pub mod error;
#[cfg(feature = "train")]
pub mod export;
pub mod gpu;
pub mod io;
#[doc(hidden)]
pub mod kernels;
#[cfg(feature = "lab")]
pub mod lab;
#[doc(hidden)]
pub mod layout;
#[cfg(feature = "train")]
pub mod mesh;
#[cfg(feature = "train")]
pub mod metrics;
#[cfg(feature = "lab")]
pub mod reference;
pub mod render;
pub mod scene;
#[doc(hidden)]
pub mod shader;
#[cfg(feature = "train")]
pub mod simplify;
pub mod stats;
#[cfg(feature = "train")]
pub mod train;

// Scenes and data sets.
#[cfg(feature = "train")]
pub use io::dataset::open as open_dataset;
pub use io::splats::{read as read_splats, write as write_splats};
pub use scene::{Camera, Dataset, Primitive, ScreenFilter, Similarity, Splats, Split, View};

// Rendering, on a device of its own or on a host's.
pub use gpu::{Gpu, GpuOptions, HostCommands, HostDevice, HostImage, REQUIRED};
pub use render::{
    Blend, ClipBox, DepthCode, HostDepth, HostTarget, Instance, Model, RenderOptions, RenderedImage, Renderer,
    ViewOptions,
};

// Training and simplification.
#[cfg(feature = "train")]
pub use render::Evaluator;
#[cfg(feature = "train")]
pub use simplify::{AutoRun as Run, CountController, prune};
#[cfg(feature = "train")]
pub use train::{StepReport, TrainConfig};

pub use error::{Error, Result};

/// Entry of the `ashfall` binary.
#[cfg(feature = "cli")]
#[doc(hidden)]
pub use cli::main;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
