//! Capacity of a frame's buffers.

use crate::gpu::Caps;
use crate::layout::{TILE_HEIGHT, TILE_WIDTH};

/// Largest frame that buffers hold. Fixed while recording; elements beyond it are counted, not drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    /// Splats.
    pub splats: usize,
    /// (Splat, tile) pairs.
    pub isects: usize,
    /// Pixels.
    pub pixels: usize,
    /// Tiles.
    pub tiles: usize,
}

impl Capacity {
    /// Smallest capacity; used before the first `reserve`.
    pub const LEAST: Capacity = Capacity {
        splats: 1,
        isects: 1,
        pixels: 1,
        tiles: 1,
    };

    /// Capacity for images of `width` × `height` pixels.
    pub fn for_image(splats: usize, isects: usize, width: u32, height: u32) -> Capacity {
        let tiles = width.div_ceil(TILE_WIDTH) * height.div_ceil(TILE_HEIGHT);
        Capacity {
            splats,
            isects,
            pixels: width as usize * height as usize,
            tiles: tiles as usize,
        }
    }

    /// The capacity limited to one binding of the device, with at most `pair_bytes` per pair in any array. Frames with
    /// more pairs are drawn in bands. All tiles of two splats always fit.
    pub fn within(self, caps: &Caps, pair_bytes: u64) -> Capacity {
        let most = caps.reach() / pair_bytes;
        Capacity {
            isects: self.isects.min(most as usize).max(2 * self.tiles),
            ..self
        }
    }

    /// Maximum of both in each field.
    pub fn max(self, other: Capacity) -> Capacity {
        Capacity {
            splats: self.splats.max(other.splats),
            isects: self.isects.max(other.isects),
            pixels: self.pixels.max(other.pixels),
            tiles: self.tiles.max(other.tiles),
        }
    }
}
