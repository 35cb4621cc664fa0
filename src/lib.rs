//! ashfall: a Vulkan-native 3D Gaussian splatting engine.
//!
//! It trains scenes from photographs and renders them on any Vulkan 1.3 device, a software one
//! included: [`io`] reads data sets into [`scene`], `train` fits splats to them, `render` draws them.

#![deny(unsafe_code)]

#[cfg(feature = "cli")]
pub mod cli;
pub mod error;
pub mod gpu;
pub mod io;
pub mod kernels;
#[cfg(feature = "lab")]
pub mod lab;
pub mod layout;
pub mod metrics;
#[cfg(feature = "lab")]
pub mod reference;
pub mod render;
pub mod scene;
pub mod shader;
pub mod simplify;
pub mod stats;
pub mod train;

pub use error::{Error, Result};
