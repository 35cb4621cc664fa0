//! Training: splats are fitted to the photographs of a data set, one step at a time.
//!
//! **Invariant:** what happens at which step is a pure function of (configuration, seed, step), and
//! refinement is a pure function of the optimiser's state on the CPU; the device only does arithmetic.
//! Nothing here reads a file but the checkpoint it is given.

pub mod checkpoint;
pub mod config;
pub mod init;
mod knn;
mod morton;
pub mod rng;
pub mod schedule;
pub mod state;
pub mod strategy;

pub use config::{Background, StrategyKind, TrainConfig};
pub use init::initial_splats;
pub use state::HostState;
pub use strategy::{RefineContext, RefineReport, SplatStats, Strategy};
