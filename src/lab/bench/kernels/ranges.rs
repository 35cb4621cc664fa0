//! Case of `ranges`: every tile's range of the sorted intersections.

use super::{KernelCase, counts, read};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::ranges::{Bindings, Params, Ranges};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, words};
use crate::layout::{COUNT_FAILED, COUNT_ISECT, COUNT_LIST_TOO_LONG};
use crate::reference::ranges::ranges as reference;

/// The sorted `tiles` of intersections; tiles from `tile_count` on are padding.
pub fn ranges<'a>(gpu: &Gpu, tiles: &[u32], tile_count: u32, list_limit: u32) -> Result<KernelCase<'a, Ranges>> {
    let len = tiles.len();
    // An empty range may lie anywhere; the kernel leaves it at 0.
    let expected: Vec<[u32; 2]> = reference(tiles, tile_count)
        .into_iter()
        .map(|[begin, end]| if begin == end { [0, 0] } else { [begin, end] })
        .collect();
    let longest = expected.iter().map(|[begin, end]| end - begin).max();
    let too_long = u32::from(longest.unwrap_or(0) > list_limit);
    let counts = counts(gpu, &[(COUNT_ISECT, len as u32)])?;
    let tiles = gpu.buffer_from("tile_from_isect", tiles)?;
    let target = gpu.buffer::<[u32; 2]>("range_from_tile", tile_count as usize)?;
    let counted = counts.clone();
    // A tile for every intersection, its neighbour's being at hand; a range for every tile.
    let work = Work::of(len, "isects").moving(4 * len + 8 * tile_count as usize);
    let case = KernelCase::new(work)
        .exact("ranges", &target, words(&expected))
        .fill(&target, 0)
        .judge(move |gpu| {
            let after = read(gpu, &counted)?;
            let flags = [COUNT_LIST_TOO_LONG, COUNT_FAILED].map(|slot| after[slot as usize]);
            Ok(vec![Output::exact("too long", words(&flags), words(&[too_long; 2]))])
        });
    Ok(case.commands(move |rec, kernel: &Ranges, _| {
        let io = Bindings {
            counts: &counts,
            tile_from_isect: &tiles,
            range_from_tile: &target,
        };
        let params = Params { tile_count, list_limit };
        kernel.record(rec, io, params, kernel.groups(len));
    }))
}
