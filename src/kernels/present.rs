//! Writes a composited image into a host's storage image.

pub use super::generated::present::*;
use crate::gpu::Groups;

/// Workgroups for an image of `size` pixels.
pub fn groups(size: [u32; 2]) -> Groups<'static> {
    Groups::Grid([size[0].div_ceil(8), size[1].div_ceil(8), 1])
}
