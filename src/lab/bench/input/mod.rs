//! Inputs of measurements and of kernel tests: scenes, and the oracle's lists and records.

pub mod lists;
pub mod pack;
pub mod random;
pub mod scene;
pub mod volume;
