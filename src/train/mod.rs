//! Training: fits splats to the photographs of a data set, one step at a time.
//!
//! **Invariant:** every step is a pure function of (configuration, seed, step), and refinement is a pure function of
//! the optimiser state on the CPU; the device only does arithmetic. The only files read here are
//! the photographs of the data set and a given checkpoint.
//!
#![doc = include_str!("../../docs/training.md")]

mod backward;
mod chain;
pub mod checkpoint;
mod colors;
pub mod config;
mod device;
pub mod exposure;
#[doc(hidden)]
pub mod filter;
mod gradients;
#[doc(hidden)]
pub mod init;
pub(crate) mod knn;
mod loss_pass;
mod memory;
mod photos;
pub mod poses;
mod reorder;
#[doc(hidden)]
pub mod rng;
mod run;
#[doc(hidden)]
pub mod schedule;
pub mod sky;
#[doc(hidden)]
pub mod smoothing;
pub mod state;
mod step;
pub mod strategy;
mod thumbnails;
mod trainer;
pub mod transients;

/// Camera at the origin along z, the principal point in the middle of the picture.
#[cfg(test)]
fn test_camera(width: u32, height: u32, focal: f64) -> crate::scene::Camera {
    crate::scene::Camera {
        width,
        height,
        focal: glam::DVec2::splat(focal),
        center: glam::DVec2::new(width.into(), height.into()) / 2.0,
        rotation: glam::DMat3::IDENTITY,
        position: glam::DVec3::ZERO,
    }
}

pub use colors::PendingColors;
pub use config::{Background, ExposureModel, MipConfig, RefineTimes, StrategyKind, TrainConfig};
pub use init::initial_splats;
pub use memory::{BufferLimits, TrainSize, first_splats, splats_expected};
pub use photos::Residency;
pub use run::{Controller, Run};
pub use state::HostState;
pub use strategy::{RefineContext, RefineReport, SplatStats};
pub use trainer::{Extremes, PhotoStates, StepReport, Trainer};
