//! Helpers of the test binaries.

#![allow(
    dead_code,
    unused_imports,
    reason = "shared by test binaries, each of which uses its own part"
)]

pub(crate) mod camera_lists;
pub(crate) mod check;
pub(crate) mod device;
pub(crate) mod files;
pub(crate) mod lists;
pub(crate) mod pack;
pub(crate) mod scenes;
