//! Division of the splats' planes of vec4 into blocks, so that no binding has to cover all of them.
//!
//! A block is a buffer of its own with the planes of some splats, one after the other. Kernels see one block at a time.
//! All splats of a block are stored with the same SH degree, and the block has no planes beyond it. If a scene has one
//! degree, blocks hold consecutive splats, and kernels see the matching part of arrays with one element per splat; else
//! an index gives the splat of each slot ([`super::Slots`]). A scene of up to `SPLATS_MIN` splats has one block per
//! degree, without spare room.

use super::precision::Precision;
use super::slots::{ByDegree, DEGREES};
use crate::gpu::{Caps, PART_ALIGNMENT};
use std::ops::Range;

/// Most splats of a block: at this size the cost of a dispatch is negligible.
const SPLATS_MAX: usize = 1 << 18;
/// Fewest splats of a block; the last block of a degree may have fewer.
const SPLATS_MIN: usize = 1 << 14;
/// Blocks of a scene between those limits: buffers for one block at a time (gradients) are then small beside those for
/// all.
const BLOCKS: usize = 4;

/// Bytes of a binding on every device (`maxStorageBufferRange`; Vulkan specification, table of required limits): more
/// than a block has.
const REACH_LEAST: u64 = 1 << 27;

/// Layout of the splats' planes in blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    /// Capacity in splats of each degree.
    pub room: ByDegree,
    /// Splats of each block of a degree except the last; a multiple of [`PART_ALIGNMENT`].
    per_block: ByDegree,
    /// Planes of vec4 of a splat of each degree.
    planes: ByDegree,
}

/// Used part of one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Index of the block.
    pub index: usize,
    /// SH degree of its splats.
    pub degree: u32,
    /// First slot; equals the first splat if slots are in splat order.
    pub first: usize,
    /// Number of splats in use.
    pub count: usize,
    /// Elements from one plane to the next.
    pub stride: usize,
}

impl Block {
    /// Range of its slots among all.
    pub fn slots(&self) -> Range<usize> {
        self.first..self.first + self.count
    }

    /// Used elements of one plane.
    pub fn plane(&self, plane: usize) -> Range<usize> {
        plane * self.stride..plane * self.stride + self.count
    }
}

impl Blocks {
    /// Blocks for splats of some degrees in a precision, each within one binding of the device.
    pub fn new(caps: &Caps, room: ByDegree, precision: Precision) -> Blocks {
        let reach = caps.reach();
        Blocks::within(reach, room, precision)
    }

    /// Blocks in full precision, the same on every device.
    pub fn anywhere(room: ByDegree) -> Blocks {
        Blocks::within(REACH_LEAST, room, Precision::Full)
    }

    fn within(reach: u64, room: ByDegree, precision: Precision) -> Blocks {
        let reach = usize::try_from(reach).unwrap_or(usize::MAX);
        let all: usize = room.iter().sum();
        let share = all.div_ceil(BLOCKS).next_multiple_of(PART_ALIGNMENT);
        let planes = std::array::from_fn(|degree| precision.plane_count(degree as u32));
        let per_block = planes.map(|planes: usize| {
            let reached = reach / (16 * planes) / PART_ALIGNMENT * PART_ALIGNMENT;
            share.clamp(SPLATS_MIN, SPLATS_MAX).min(reached.max(PART_ALIGNMENT))
        });
        Blocks {
            room,
            per_block,
            planes,
        }
    }

    /// Capacity in splats of all degrees.
    pub fn splats(&self) -> usize {
        self.room.iter().sum()
    }

    /// Planes of vec4 of splats of a degree.
    pub fn planes(&self, degree: u32) -> usize {
        self.planes[degree as usize]
    }

    /// Vec4 of all blocks.
    pub fn vectors(&self) -> usize {
        self.sizes().iter().sum()
    }

    /// Slots of each block.
    pub fn strides(self) -> Vec<usize> {
        self.of(self.room).map(|block| block.stride).collect()
    }

    /// Vec4 of each block.
    pub fn sizes(self) -> Vec<usize> {
        let all = self.of(self.room);
        all.map(|block| block.stride * self.planes(block.degree)).collect()
    }

    /// Slots of each block, where an index says whose they are: where splats are of several degrees.
    pub(super) fn index_sizes(self) -> Vec<usize> {
        let is_mixed = self.room.iter().filter(|&&room| room > 0).count() > 1;
        let all = self.of(self.room).filter(|_| is_mixed);
        all.map(|block| block.stride).collect()
    }

    /// Blocks in use with `counts` splats of each degree, in order of degree.
    pub fn of(self, counts: ByDegree) -> impl Iterator<Item = Block> {
        let fits = counts.iter().zip(self.room).all(|(&n, room)| n <= room);
        assert!(fits, "{counts:?} splats in {self:?}");
        (0..DEGREES).flat_map(move |degree| {
            let per_block = self.per_block[degree];
            let blocks = |room: &[usize]| -> usize {
                let each = room.iter().zip(self.per_block);
                each.map(|(room, per_block)| room.div_ceil(per_block)).sum()
            };
            let before = blocks(&self.room[..degree]);
            let first: usize = counts[..degree].iter().sum();
            (0..counts[degree].div_ceil(per_block)).map(move |block| {
                let begin = block * per_block;
                Block {
                    index: before + block,
                    degree: degree as u32,
                    first: first + begin,
                    count: (counts[degree] - begin).min(per_block),
                    stride: (self.room[degree] - begin).min(per_block),
                }
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_several_degrees_follow_one_another() {
        let room = [70_000, 0, 3, 20_000];
        let blocks = Blocks::anywhere(room);
        let counts = [65_000, 0, 2, 0];
        let (mut slots, mut used) = (0, [0; DEGREES]);
        for block in blocks.of(counts) {
            assert_eq!(block.first, slots);
            slots = block.slots().end;
            used[block.degree as usize] += block.count;
            assert!(block.count > 0 && block.count <= block.stride);
        }
        assert_eq!(used, counts);
        let all: Vec<Block> = blocks.of(room).collect();
        assert!(all.iter().map(|block| block.index).eq(0..all.len()));
        // The place of a block does not depend on the number of splats in it.
        for block in blocks.of(counts) {
            let whole = all[block.index];
            assert_eq!((block.degree, block.stride), (whole.degree, whole.stride));
        }
        let vectors = 70_000 * 4 + 3 * 10 + 20_000 * 15;
        assert_eq!(blocks.vectors(), vectors);
    }
}
