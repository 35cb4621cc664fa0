//! What is measured: scenes, and the lists and records that kernels read, made by the oracle. Tests use them too:
//! the same cases test and time.

pub mod lists;
pub mod pack;
pub mod random;
pub mod scene;
pub mod volume;
