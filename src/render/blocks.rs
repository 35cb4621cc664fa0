//! How splats' planes of vec4 are cut into blocks, so that no binding has to reach all of them.
//!
//! A block is a buffer of its own with some consecutive splats' planes, one after the other. Kernels see one
//! block at a time, and of the arrays that hold one element per splat the part that belongs to it. A scene of
//! `SPLATS_MIN` splats or fewer is one block without anything to spare.

use super::model::plane_count;
use crate::Result;
use crate::gpu::{Buffer, Caps, Gpu, PART_ALIGNMENT};
use std::ops::Range;

/// Most splats of a block: enough for kernels not to notice.
const SPLATS_MAX: usize = 1 << 18;
/// Fewest splats of a block, unless there are fewer.
const SPLATS_MIN: usize = 1 << 14;
/// Blocks that a scene between those limits has: what is needed of one block at a time (gradients) is little
/// then beside what is needed of all.
const BLOCKS: usize = 4;

/// Bytes that a binding reaches on every device (`maxStorageBufferRange`; Vulkan specification, table of
/// required limits): more than a block has.
const REACH_LEAST: u64 = 1 << 27;

/// Where splats' planes lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    /// Splats that there is room for.
    pub room: usize,
    /// Splats of every block but the last; a multiple of [`PART_ALIGNMENT`].
    pub per_block: usize,
    /// Planes of vec4 that a splat takes.
    pub planes: usize,
}

/// One block, as far as it is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Its place among the blocks.
    pub index: usize,
    /// Its first splat.
    pub first: usize,
    /// Its splats in use.
    pub count: usize,
    /// Elements between two of its planes.
    pub stride: usize,
}

impl Block {
    /// Its splats among all.
    pub fn splats(&self) -> Range<usize> {
        self.first..self.first + self.count
    }

    /// The elements of one plane that are in use.
    pub fn plane(&self, plane: usize) -> Range<usize> {
        plane * self.stride..plane * self.stride + self.count
    }
}

impl Blocks {
    /// Blocks for `room` splats of a degree, each within the reach of one binding of the device.
    pub fn new(caps: &Caps, room: usize, sh_degree: u32) -> Blocks {
        Blocks::of_planes(caps, room, plane_count(sh_degree))
    }

    /// The same for splats that take so many planes.
    pub fn of_planes(caps: &Caps, room: usize, planes: usize) -> Blocks {
        let reach = caps.max_storage_range.min(caps.max_allocation);
        Blocks::within(reach, room, planes)
    }

    /// The same, as it is on every device.
    pub fn anywhere(room: usize, sh_degree: u32) -> Blocks {
        Blocks::within(REACH_LEAST, room, plane_count(sh_degree))
    }

    fn within(reach: u64, room: usize, planes: usize) -> Blocks {
        let reach = usize::try_from(reach).unwrap_or(usize::MAX) / (16 * planes);
        let share = room.div_ceil(BLOCKS).next_multiple_of(PART_ALIGNMENT);
        let reached = (reach / PART_ALIGNMENT * PART_ALIGNMENT).max(PART_ALIGNMENT);
        let per_block = share.clamp(SPLATS_MIN, SPLATS_MAX).min(reached);
        Blocks {
            room,
            per_block,
            planes,
        }
    }

    /// Number of blocks; at least one.
    pub fn count(&self) -> usize {
        self.room.div_ceil(self.per_block).max(1)
    }

    /// Elements between two planes of a block: splats that it has room for.
    pub fn stride(&self, block: usize) -> usize {
        let before = block * self.per_block;
        self.room.saturating_sub(before).min(self.per_block).max(1)
    }

    /// The blocks that the first `splats` splats take.
    pub fn of(self, splats: usize) -> impl Iterator<Item = Block> {
        assert!(splats <= self.room, "{splats} splats in {self:?}");
        (0..splats.div_ceil(self.per_block)).map(move |index| {
            let first = index * self.per_block;
            Block {
                index,
                first,
                count: (splats - first).min(self.per_block),
                stride: self.stride(index),
            }
        })
    }

    /// A buffer for each block.
    pub fn buffers(&self, gpu: &Gpu, name: &str) -> Result<Vec<Buffer<[f32; 4]>>> {
        (0..self.count())
            .map(|block| gpu.buffer(name, self.stride(block) * self.planes))
            .collect()
    }
}
