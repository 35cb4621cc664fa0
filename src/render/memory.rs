//! What a frame takes of the device's memory, buffer by buffer, as a closed formula of its capacity.
//!
//! A test holds it against what is allocated, name by name, so that neither changes without the other.

use super::blocks::Blocks;
use super::capacity::Capacity;
use super::scratch::{DEPTH_SORT, tile_sort_widest};
use crate::kernels::rasterize::Outputs;
use crate::layout::*;

/// What a buffer's bytes are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Purpose {
    /// What the scene is.
    Parameters,
    /// The optimiser's memory.
    Moments,
    /// The photographs.
    Photos,
    /// Lists of (splat, tile) pairs and what is kept for each.
    Intersections,
    /// Gradients and statistics of splats.
    Gradients,
    /// What a frame keeps for each splat.
    Splats,
    /// What a frame keeps for each pixel or tile.
    Pixels,
    /// Data on their way to and from the device, and counts.
    Transfer,
}

impl Purpose {
    /// Whether it counts as what a run cannot do without: the rest is working memory.
    pub fn is_essential(self) -> bool {
        use Purpose::*;
        matches!(self, Parameters | Moments | Photos | Intersections)
    }

    /// In a word.
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

/// The buffers of one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// Their name.
    pub name: &'static str,
    /// What they are for.
    pub purpose: Purpose,
    /// Their bytes together.
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

/// Bytes of all.
pub fn total(needs: &[Need]) -> u64 {
    needs.iter().map(|need| need.bytes).sum()
}

/// A scene's parameters: those of [`super::Model`].
pub fn model_needs(blocks: Blocks) -> Need {
    Need::new("params", Purpose::Parameters, 16, blocks.vectors())
}

/// And what says whose they are, where splats are of several degrees.
pub fn index_needs(blocks: Blocks) -> Need {
    let is_mixed = blocks.room.iter().filter(|&&room| room > 0).count() > 1;
    let slots = if is_mixed { blocks.splats() } else { 0 };
    Need::new("splat_from_slot", Purpose::Parameters, 4, slots)
}

/// The buffers that a frame works in: [`super::Scratch`].
pub fn frame_needs(capacity: Capacity, outputs: Outputs) -> Vec<Need> {
    let Capacity {
        splats,
        isects,
        pixels,
        tiles,
    } = capacity;
    let tile_table = tile_sort_widest(tiles).table_len(isects);
    let table = DEPTH_SORT.table_len(splats).max(tile_table);
    // One table serves both sorts; it is filed under what makes it as long as it is.
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

/// (Splat, tile) pairs to expect of a frame at most, where nothing better is known.
///
/// A splat of w pixels square meets (w/8 + 1)(w/16 + 1) tiles. Scenes cover every pixel about as often
/// however many splats they are made of, so w² is `OVERLAP` · pixels / splats, and the pairs are
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
