//! Depth bands: parts of a frame that wants more than its buffers hold.
//!
//! A band is some splats that follow each other in depth. Their (splat, tile) pairs are listed, sorted and
//! composited, then those of the next band in the same buffers, over the image as it stands. Every pixel meets the
//! same splats in the same order with the same numbers, so that bands change no bit of the image. Which splats a
//! band holds is decided on the device; how many bands there may be is decided before, and a frame that was not
//! done with the last of them says so in its counts.

use super::capacity::Capacity;
use crate::gpu::DeviceKind;
use crate::layout::*;
use crate::{Error, Result};

/// Most bands of a frame.
const BANDS_MAX: u32 = 4095;

/// The bands of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthBands {
    /// Bands that are recorded; those that turn out to be empty cost little.
    pub count: u32,
    /// Splats that a band may hold.
    pub ranks: u32,
}

impl Default for DepthBands {
    /// A single band of everything.
    fn default() -> DepthBands {
        DepthBands {
            count: 1,
            ranks: u32::MAX,
        }
    }
}

impl DepthBands {
    /// The bands that a frame needs which has left `counts`, in buffers of `capacity`. No fewer splats than a tile's
    /// list may have go to a band.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for more pairs than can be counted.
    pub fn after(self, counts: &[u32], capacity: &Capacity, list_limit: u32) -> Result<DepthBands> {
        let at = |slot: u32| counts[slot as usize];
        let wanted = at(COUNT_ISECT_WANTED);
        if wanted == u32::MAX {
            return Err(Error::Unsupported {
                what: "more than 4,294,967,294 pairs of a splat and a tile that it touches, in one picture".into(),
            });
        }
        let ranks = match at(COUNT_LIST_TOO_LONG) {
            0 => self.ranks,
            _ => list_limit,
        };
        // A band that ends for want of room lacks less than one splat's tiles.
        let least = capacity.isects.saturating_sub(capacity.tiles) + 1;
        let by_room = match wanted as usize {
            wanted if wanted <= capacity.isects => 0,
            wanted => wanted / least,
        };
        let by_ranks = (at(COUNT_VISIBLE) / ranks) as usize;
        let count = by_room + by_ranks + 1;
        match u32::try_from(count) {
            Ok(count) if count <= BANDS_MAX => Ok(DepthBands { count, ranks }),
            _ => Err(Error::Unsupported {
                what: format!("a picture in {count} passes"),
            }),
        }
    }
}

/// Intersections that one tile may have in a band. llvmpipe leaves all loops of an invocation after 65,535 turns in
/// total. What walks a tile's list takes it in batches of at least eight, two splats a turn, so that n take at most
/// 5 (n / 8 + 1) turns: 62,505 for these, which leaves room for loops over lanes. Other devices run loops to their end.
pub fn list_limit(kind: DeviceKind) -> u32 {
    match kind {
        DeviceKind::Cpu => 100_000,
        _ => u32::MAX,
    }
}

/// Turns that all loops of an invocation take together at most, as [`list_limit`] counts them.
pub fn loop_turns(kind: DeviceKind) -> u32 {
    5 * (list_limit(kind) / 8 + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Thresholds bands as `plan` does; returns their number.
    fn cut(tiles: &[u32], capacity: usize, ranks: u32) -> u32 {
        let (mut bands, mut isects, mut splats) = (1, 0, 0);
        for &count in tiles {
            if isects + count as usize > capacity || splats == ranks {
                (bands, isects, splats) = (bands + 1, 0, 0);
            }
            (isects, splats) = (isects + count as usize, splats + 1);
        }
        bands
    }

    #[test]
    fn no_frame_needs_more_bands_than_are_said() {
        let capacity = |isects| Capacity {
            splats: 1000,
            isects,
            pixels: 1,
            tiles: 50,
        };
        for seed in 0..200u32 {
            let tiles: Vec<u32> = (0..seed * 5)
                .map(|i| 1 + (i * 7919 + seed * 104_729) % 50)
                .collect();
            let mut counts = [0; COUNT_SLOTS as usize];
            counts[COUNT_VISIBLE as usize] = tiles.len() as u32;
            counts[COUNT_ISECT_WANTED as usize] = tiles.iter().sum();
            for too_long in [0, 1] {
                counts[COUNT_LIST_TOO_LONG as usize] = too_long;
                for isects in [100, 150, 1000, 100_000] {
                    let bands = DepthBands::default()
                        .after(&counts, &capacity(isects), 60)
                        .unwrap_or_else(|error| panic!("{error}"));
                    let needed = cut(&tiles, isects, bands.ranks);
                    assert!(needed <= bands.count, "{needed} of {bands:?}");
                    assert!(bands.count <= 3 * needed + 1, "{needed} of {bands:?}");
                }
            }
        }
    }
}
