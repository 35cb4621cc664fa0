//! Device memory of a frame, buffer by buffer, as a closed formula of its capacity.
//!
//! A test compares it with the allocations, name by name.

use super::blocks::Blocks;
use super::capacity::Capacity;
use super::scratch::{DEPTH_SORT, tile_sort_widest};
use crate::kernels::rasterize::Outputs;
use crate::layout::*;

/// Purpose of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Purpose {
    /// Parameters of the scene.
    Parameters,
    /// State of the optimiser.
    Moments,
    /// Photographs.
    Photos,
    /// Lists of (splat, tile) pairs, and data of each pair.
    Intersections,
    /// Gradients and statistics of splats.
    Gradients,
    /// A frame's data of each splat.
    Splats,
    /// A frame's data of each pixel or tile.
    Pixels,
    /// Data on their way to and from the device, and counts.
    Transfer,
}

impl Purpose {
    /// True for the indispensable memory of a run; the rest is working memory.
    pub fn is_essential(self) -> bool {
        use Purpose::*;
        matches!(self, Parameters | Moments | Photos | Intersections)
    }

    /// Name in one word.
    pub fn name(self) -> &'static str {
        match self {
            Purpose::Parameters => "parameters",
            Purpose::Moments => "moments",
            Purpose::Photos => "photos",
            Purpose::Intersections => "intersections",
            Purpose::Gradients => "gradients",
            Purpose::Splats => "splats",
            Purpose::Pixels => "pixels",
            Purpose::Transfer => "transfer",
        }
    }
}

/// Memory of the buffers of one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// Name of the buffers.
    pub name: &'static str,
    /// Purpose of the buffers.
    pub purpose: Purpose,
    /// Total bytes.
    pub bytes: u64,
}

impl Need {
    /// `count` elements of `size` bytes.
    pub fn new(name: &'static str, purpose: Purpose, size: usize, count: usize) -> Need {
        Need {
            name,
            purpose,
            bytes: size as u64 * count as u64,
        }
    }
}

/// Sum of all bytes.
pub fn total(needs: &[Need]) -> u64 {
    needs.iter().map(|need| need.bytes).sum()
}

/// Parameter buffers of a [`super::Model`].
pub fn model_needs(blocks: Blocks) -> Need {
    Need::new("params", Purpose::Parameters, 16, blocks.vectors())
}

/// Index buffers of a [`super::Model`]; 0 bytes if all splats have one degree.
pub fn index_needs(blocks: Blocks) -> Need {
    let is_mixed = blocks.room.iter().filter(|&&room| room > 0).count() > 1;
    let slots = if is_mixed { blocks.splats() } else { 0 };
    Need::new("splat_from_slot", Purpose::Parameters, 4, slots)
}

/// Buffers of a frame: those of [`super::Scratch`].
pub fn frame_needs(capacity: Capacity, outputs: Outputs) -> Vec<Need> {
    let Capacity {
        splats,
        isects,
        pixels,
        tiles,
    } = capacity;
    let tile_table = tile_sort_widest(tiles).table_len(isects);
    let table = DEPTH_SORT.table_len(splats).max(tile_table);
    // One table serves both sorts; its purpose is that of the sort with the larger one.
    let sorting = match table > tile_table {
        true => Purpose::Splats,
        false => Purpose::Intersections,
    };
    let sums = table.max(splats).div_ceil(SCAN_CHUNK as usize);
    use Purpose::*;
    vec![
        Need::new("view", Transfer, size_of::<View>(), 1),
        Need::new("counts", Transfer, 4, COUNT_SLOTS as usize),
        Need::new(
            "args",
            Transfer,
            size_of::<DispatchArgs>(),
            ARGS_SLOTS as usize,
        ),
        Need::new("ellipse_from_splat", Splats, 16, splats),
        Need::new("whiten_rg_from_splat", Splats, 16, splats),
        Need::new("blue_depth_from_splat", Splats, 8, splats),
        Need::new("tile_count_from_splat", Splats, 4, splats),
        Need::new("visible_from_splat", Splats, 4, splats),
        Need::new("depth_from_visible", Splats, 8, splats),
        Need::new("splat_from_visible", Splats, 8, splats),
        Need::new("tile_count_from_rank", Splats, 4, splats),
        Need::new("isect_from_rank", Splats, 4, splats),
        Need::new("emitted_from_splat", Splats, 4, splats),
        Need::new("tile_from_isect", Intersections, 8, isects),
        Need::new("emitted_from_isect", Intersections, 8, isects),
        Need::new("splat_from_emitted", Intersections, 4, isects),
        Need::new("table", sorting, 4, table),
        Need::new("places", sorting, 4, table),
        Need::new("sums", sorting, 4, sums),
        Need::new("range_from_tile", Pixels, 8, tiles),
        Need::new("image", Pixels, 16, pixels),
        Need::new("depth", Pixels, 4, if outputs.depth { pixels } else { 1 }),
        Need::new(
            "isect_end_from_pixel",
            Pixels,
            4,
            if outputs.ends { pixels } else { 1 },
        ),
    ]
}

/// Estimated (splat, tile) pairs of a frame, for capacities before the first frame.
///
/// A splat of w pixels square meets (w/8 + 1)(w/16 + 1) tiles. The coverage of a pixel hardly depends on the number of
/// splats, so w² is `OVERLAP` · pixels / splats, and the pairs are
/// splats + (1/8 + 1/16) √(`OVERLAP` · pixels · splats) + `OVERLAP` · pixels / 128.
pub fn isects_expected(splats: usize, width: u32, height: u32) -> usize {
    let (splats, pixels) = (splats as f64, f64::from(width) * f64::from(height));
    let [tile_width, tile_height] = [TILE_WIDTH, TILE_HEIGHT].map(f64::from);
    let edges = 1.0 / tile_width + 1.0 / tile_height;
    let tiles = OVERLAP * pixels / (tile_width * tile_height);
    (splats + edges * (OVERLAP * pixels * splats).sqrt() + tiles) as usize
}

/// Bounding squares over a pixel, all splats of the scene counted. Fitted to trained scenes: the fox at 270×480
/// with 62,840 splats had 215,856 pairs (211,350 by the formula), the built-in scene at 160×120 with 12,000
/// splats 36,204 (36,000), with 15,000 splats 46,231 (41,123).
const OVERLAP: f64 = 40.0;
