//! Buffers of a frame, sized by a capacity.

use super::band_replay::BandReplay;
use super::capacity::Capacity;
use super::memory::{Purpose, buffers};
use crate::gpu::Buffer;
use crate::kernels::rasterize::Outputs;
use crate::kernels::sort::Layout;
use crate::layout::*;

buffers! {
    /// A frame's buffers. Names say what indexes what: `a_from_b` is indexed by `b` and gives `a`.
    pub struct Scratch(capacity: Capacity, outputs: Outputs)
    beside {
        /// Capacity of the buffers.
        pub capacity: Capacity = capacity,
        /// State between the bands of a frame, for gradients of more than one.
        pub(crate) replay: Option<BandReplay> = None,
    }
    {
        view: Buffer<View>, Transfer, 1;
        counts: Buffer<u32>, Transfer, COUNT_SLOTS as usize;
        args: Buffer<DispatchArgs>, Transfer, ARGS_SLOTS as usize;
        ellipse_from_splat: Buffer<[f32; 4]>, Splats, capacity.splats;
        whiten_rg_from_splat: Buffer<[f32; 4]>, Splats, capacity.splats;
        blue_depth_from_splat: Buffer<[f32; 2]>, Splats, capacity.splats;
        plane_from_splat: Buffer<[f32; 3]>, Splats, plane_count(capacity, outputs);
        tile_count_from_splat: Buffer<u32>, Splats, capacity.splats;
        visible_from_splat: Buffer<u32>, Splats, capacity.splats;
        depth_from_visible: Vec<Buffer<u32>>, Splats, vec![capacity.splats; 2];
        splat_from_visible: Vec<Buffer<u32>>, Splats, vec![capacity.splats; 2];
        tile_count_from_rank: Buffer<u32>, Splats, capacity.splats;
        isect_from_rank: Buffer<u32>, Splats, capacity.splats;
        emitted_from_splat: Buffer<u32>, Splats, capacity.splats;
        tile_from_isect: Vec<Buffer<u32>>, Intersections, vec![capacity.isects; 2];
        emitted_from_isect: Vec<Buffer<u32>>, Intersections, vec![capacity.isects; 2];
        splat_from_emitted: Buffer<u32>, Intersections, capacity.isects;
        table: Buffer<u32>, table(capacity).0, table(capacity).1;
        places: Buffer<u32>, table(capacity).0, table(capacity).1;
        sums: Buffer<u32>, table(capacity).0, sums_len(capacity);
        range_from_tile: Buffer<[u32; 2]>, Pixels, capacity.tiles;
        image: Buffer<f32>, Pixels, 4 * capacity.pixels;
        depth: Buffer<f32>, Pixels, if outputs.depth { capacity.pixels } else { 1 };
        surface: Buffer<f32>, Pixels, surface_len(capacity, outputs);
        isect_end_from_pixel: Buffer<u32>, Pixels, if outputs.ends || outputs.ids { capacity.pixels } else { 1 };
        depth_from_pixel: Buffer<f32>, Pixels, if outputs.ids { capacity.pixels } else { 1 };
        stored_from_pixel: Buffer<f32>, Pixels, if outputs.ids { capacity.pixels } else { 1 };
        limit_from_pixel: Buffer<f32>, Pixels, if outputs.limit { capacity.pixels } else { 1 };
        limit_from_tile: Buffer<f32>, Pixels, if outputs.limit { capacity.tiles } else { 1 };
    }
}

/// Number of planes: those of splats for surfaces, and those of surfels.
fn plane_count(capacity: Capacity, outputs: Outputs) -> usize {
    match outputs.has_planes() {
        true => capacity.splats,
        false => 1,
    }
}

/// Length of the planes of surfaces.
fn surface_len(capacity: Capacity, outputs: Outputs) -> usize {
    match (outputs.surface, outputs.spread) {
        (_, true) => SPREAD_PLANES as usize * capacity.pixels,
        (true, false) => SURFACE_PLANES as usize * capacity.pixels,
        (false, false) => 1,
    }
}

/// Length of the table that serves both sorts, filed under what makes it as long as it is.
fn table(capacity: Capacity) -> (Purpose, usize) {
    let by_depth = DEPTH_SORT.table_len(capacity.splats);
    let by_tile = tile_sort_widest(capacity.tiles).table_len(capacity.isects);
    match by_depth > by_tile {
        true => (Purpose::Splats, by_depth),
        false => (Purpose::Intersections, by_tile),
    }
}

/// Length of the chunk sums of a scan over the table or the splats.
fn sums_len(capacity: Capacity) -> usize {
    let scanned = table(capacity).1.max(capacity.splats);
    scanned.div_ceil(SCAN_CHUNK as usize)
}

/// Sort by depth: four passes of eight bits over all 32.
pub(crate) const DEPTH_SORT: Layout = Layout {
    digit_bits: 8,
    passes: 4,
    count_slot: COUNT_VISIBLE,
    chunk_slot: COUNT_VISIBLE_CHUNK,
    table_slot: COUNT_VISIBLE_TABLE,
    chunk_args: ARGS_VISIBLE_CHUNK,
    table_args: ARGS_VISIBLE_TABLE,
};

/// Most bits of a tile digit.
const TILE_DIGIT_BITS: u32 = 11;

/// Sort by tile: fewest passes over the bits of tile indices with digits of at most eleven bits. One value beyond the
/// last tile is padding.
pub(crate) fn tile_sort(tiles: usize) -> Layout {
    let bits = usize::BITS - tiles.leading_zeros();
    let passes = bits.div_ceil(TILE_DIGIT_BITS).max(1);
    Layout {
        digit_bits: bits.div_ceil(passes),
        passes,
        count_slot: COUNT_ISECT,
        chunk_slot: COUNT_ISECT_CHUNK,
        table_slot: COUNT_ISECT_TABLE,
        chunk_args: ARGS_ISECT_CHUNK,
        table_args: ARGS_ISECT_TABLE,
    }
}

/// The layout of the widest tables that images of up to so many tiles use: a smaller image may use wider
/// digits than the largest one does.
fn tile_sort_widest(tiles: usize) -> Layout {
    Layout {
        digit_bits: TILE_DIGIT_BITS.min(tiles.ilog2() + 1),
        ..tile_sort(tiles)
    }
}
