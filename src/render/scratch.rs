//! Buffers of a frame, sized by a capacity.

use super::band_replay::BandReplay;
use super::capacity::Capacity;
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::kernels::rasterize::Outputs;
use crate::kernels::sort::{Layout, Pairs, Tables};
use crate::layout::*;

/// Buffers of a frame. Names are index maps: `a_from_b` is indexed by `b` and gives `a`.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// Largest frame that fits.
    pub capacity: Capacity,
    pub(crate) view: Buffer<View>,
    pub(crate) counts: Buffer<u32>,
    pub(crate) args: Buffer<DispatchArgs>,
    pub(crate) ellipse_from_splat: Buffer<[f32; 4]>,
    pub(crate) whiten_rg_from_splat: Buffer<[f32; 4]>,
    pub(crate) blue_depth_from_splat: Buffer<[f32; 2]>,
    pub(crate) tile_count_from_splat: Buffer<u32>,
    pub(crate) visible_from_splat: Buffer<u32>,
    pub(crate) by_depth: Pairs,
    pub(crate) tile_count_from_rank: Buffer<u32>,
    pub(crate) isect_from_rank: Buffer<u32>,
    pub(crate) emitted_from_splat: Buffer<u32>,
    pub(crate) by_tile: Pairs,
    pub(crate) splat_from_emitted: Buffer<u32>,
    pub(crate) tables: Tables,
    pub(crate) range_from_tile: Buffer<[u32; 2]>,
    pub(crate) image: Buffer<f32>,
    pub(crate) depth: Buffer<f32>,
    pub(crate) isect_end_from_pixel: Buffer<u32>,
    /// State of the bands, for gradients of a frame in more than one.
    pub(crate) replay: Option<BandReplay>,
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

/// Layout with the largest tables of images of up to `tiles` tiles: a smaller image may use wider digits than the
/// largest one.
pub(super) fn tile_sort_widest(tiles: usize) -> Layout {
    Layout {
        digit_bits: TILE_DIGIT_BITS.min(tiles.ilog2() + 1),
        ..tile_sort(tiles)
    }
}

impl Scratch {
    /// Allocates the buffers for images with `outputs`.
    pub fn new(gpu: &Gpu, capacity: Capacity, outputs: Outputs) -> Result<Scratch> {
        let capacity = capacity.within(gpu.caps(), 4);
        let Capacity {
            splats,
            isects,
            pixels,
            tiles,
        } = capacity;
        let tile_table = tile_sort_widest(tiles).table_len(isects);
        let table = DEPTH_SORT.table_len(splats).max(tile_table);
        let scanned = table.max(splats);
        let pair = |name: &str, len| -> Result<[Buffer<u32>; 2]> {
            Ok([gpu.buffer(name, len)?, gpu.buffer(name, len)?])
        };
        Ok(Scratch {
            capacity,
            view: gpu.buffer("view", 1)?,
            counts: gpu.buffer("counts", COUNT_SLOTS as usize)?,
            args: gpu.buffer("args", ARGS_SLOTS as usize)?,
            ellipse_from_splat: gpu.buffer("ellipse_from_splat", splats)?,
            whiten_rg_from_splat: gpu.buffer("whiten_rg_from_splat", splats)?,
            blue_depth_from_splat: gpu.buffer("blue_depth_from_splat", splats)?,
            tile_count_from_splat: gpu.buffer("tile_count_from_splat", splats)?,
            visible_from_splat: gpu.buffer("visible_from_splat", splats)?,
            by_depth: Pairs {
                keys: pair("depth_from_visible", splats)?,
                values: pair("splat_from_visible", splats)?,
            },
            tile_count_from_rank: gpu.buffer("tile_count_from_rank", splats)?,
            isect_from_rank: gpu.buffer("isect_from_rank", splats)?,
            emitted_from_splat: gpu.buffer("emitted_from_splat", splats)?,
            by_tile: Pairs {
                keys: pair("tile_from_isect", isects)?,
                values: pair("emitted_from_isect", isects)?,
            },
            splat_from_emitted: gpu.buffer("splat_from_emitted", isects)?,
            tables: Tables {
                counted: gpu.buffer("table", table)?,
                places: gpu.buffer("places", table)?,
                sums: gpu.buffer("sums", scanned.div_ceil(SCAN_CHUNK as usize))?,
            },
            range_from_tile: gpu.buffer("range_from_tile", tiles)?,
            image: gpu.buffer("image", 4 * pixels)?,
            depth: gpu.buffer("depth", if outputs.depth { pixels } else { 1 })?,
            isect_end_from_pixel: gpu.buffer(
                "isect_end_from_pixel",
                if outputs.ends { pixels } else { 1 },
            )?,
            replay: None,
        })
    }
}
