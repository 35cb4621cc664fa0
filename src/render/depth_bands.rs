//! Depth bands: parts of a frame with more (splat, tile) pairs than its buffers hold.
//!
//! A band is a range of splats in depth order. Their pairs are listed, sorted and composited, then those of the next
//! band in the same buffers, onto the same image. Every pixel composites the same splats in the same order with the
//! same numbers, so that bands change no bit of the image. The device determines the range of each band; the number of
//! bands is fixed when recording, and a frame unfinished after the last one sets `COUNT_FAILED`.

use super::capacity::Capacity;
use crate::gpu::DeviceKind;
use crate::layout::*;
use crate::{Error, Result};

/// Most bands of a frame.
const BANDS_MAX: u32 = 4095;

/// The bands of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthBands {
    /// Recorded bands; empty ones cost little.
    pub count: u32,
    /// Most splats of a band.
    pub ranks: u32,
}

impl Default for DepthBands {
    /// A single band with all splats.
    fn default() -> DepthBands {
        DepthBands {
            count: 1,
            ranks: u32::MAX,
        }
    }
}

impl DepthBands {
    /// Bands that complete the frame that left `counts`, in buffers of `capacity`. Splats per band are limited only
    /// after a tile's list was too long, then to `list_limit`.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for more pairs than 32 bits count, or more than 4095 bands.
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
        // A band that ends at the capacity leaves less than one splat's tiles unused.
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

/// Most intersections of a tile in one band. llvmpipe ends all loops of an invocation after 65,535 iterations in total.
/// Kernels read a tile's list in batches of at least eight, two splats per iteration, so that n take at most
/// 5 (n / 8 + 1) iterations: 62,505 for this limit, which leaves some for loops over lanes. Other devices
/// have no limit.
pub fn list_limit(kind: DeviceKind) -> u32 {
    match kind {
        DeviceKind::Cpu => 100_000,
        _ => u32::MAX,
    }
}

/// Most iterations of all loops of an invocation together, as counted for [`list_limit`].
pub fn loop_turns(kind: DeviceKind) -> u32 {
    5 * (list_limit(kind) / 8 + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of bands, divided as `plan` does.
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
            let tiles: Vec<u32> = (0..seed * 5).map(|i| 1 + (i * 7919 + seed * 104_729) % 50).collect();
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
