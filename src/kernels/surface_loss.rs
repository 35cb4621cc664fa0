//! Gradient of the terms of geometry by a frame's surface, a workgroup a tile.

pub use super::generated::surface_loss::*;
use crate::gpu::Groups;
use crate::layout::SURFACE_TILE;

/// Workgroups for `size` drawn pixels.
pub fn groups(size: [u32; 2]) -> Groups<'static> {
    let [columns, rows] = size.map(|pixels| pixels.div_ceil(SURFACE_TILE));
    Groups::Count(columns * rows)
}
