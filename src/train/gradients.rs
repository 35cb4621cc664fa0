//! Buffers of a step beyond those of rendering: gradients of the frame, and records of every (splat, tile) pair.

use super::transients::PATCH_WORDS;
use crate::Result;
use crate::gpu::{Buffer, Gpu, PART_ALIGNMENT};
use crate::kernels::rasterize::{Outputs, SurfelMode};
use crate::layout::{
    D_SPREAD_PLANES, D_SURFACE_PLANES, REST_SPOT, REST_SURFACE, REST_TILT, SPREAD_PLANES, SURFACE_PLANES,
};
use crate::render::{Allocate, Capacity, Need, Purpose, buffers};

buffers! {
    /// Buffers of a step beyond those of rendering.
    pub(crate) struct Gradients(capacity: Capacity, outputs: Outputs) {
        records: Records, Intersections, (capacity, outputs);
        /// An image of these tiles has at most as many loss tiles as compositing tiles.
        loss_from_tile: Buffer<[f32; 4]>, Pixels, capacity.tiles;
        /// Of the loss, and both sums of the photograph's gains.
        loss: Buffer<[f32; 4]>, Pixels, 3;
        /// By the colours, and by surfaces.
        d_image: Buffer<f32>, Pixels, slope_planes(outputs) * capacity.pixels;
        /// A bit of each patch that the loss leaves out.
        ignored: Buffer<u32>, Pixels, PATCH_WORDS;
    }
}

/// Words of the gradients of a (splat, tile) pair in each of three arrays.
pub(crate) fn record_widths(outputs: Outputs) -> [usize; 3] {
    let part = |is_there: bool, width: u32| if is_there { width as usize } else { 0 };
    let rest = 1
        + part(outputs.has_planes(), REST_TILT)
        + part(outputs.surfels == SurfelMode::Any, REST_SPOT)
        + part(outputs.surface, REST_SURFACE);
    [4, 4, rest]
}

/// Planes of the gradient of a frame.
fn slope_planes(outputs: Outputs) -> usize {
    match (outputs.surface, outputs.spread) {
        (_, true) => D_SPREAD_PLANES as usize,
        (true, false) => D_SURFACE_PLANES as usize,
        (false, false) => 3,
    }
}

/// Bytes of a pixel in the largest array of a step.
pub(crate) fn pixel_bytes(outputs: Outputs) -> u64 {
    let slopes = 9;
    let surface = match (outputs.surface, outputs.spread) {
        (_, true) => SPREAD_PLANES as usize,
        (true, false) => SURFACE_PLANES as usize,
        (false, false) => 0,
    };
    4 * slopes.max(slope_planes(outputs)).max(surface) as u64
}

/// Gradients of every (splat, tile) pair in three arrays, in one buffer with the slopes of SSIM: these are last read
/// before the first record is written.
#[derive(Clone, Debug)]
pub(crate) struct Records {
    pub(super) ssim_slope: Buffer<[f32; 3]>,
    pub(super) d_shape_from_source: Buffer<[f32; 4]>,
    pub(super) d_tone_from_source: Buffer<[f32; 4]>,
    pub(super) d_rest_from_source: Buffer<f32>,
}

impl Allocate for Records {
    type Size = (Capacity, Outputs);

    fn allocate(gpu: &Gpu, name: &str, (capacity, outputs): Self::Size) -> Result<Records> {
        let (slopes, isects) = (9 * capacity.pixels, capacity.isects);
        let widths = record_widths(outputs);
        let widest = widths.into_iter().max().unwrap_or(0);
        gpu.check_reach("d_shape_from_source", (4 * widest * isects) as u64)?;
        gpu.check_reach("ssim_slope", 4 * slopes as u64)?;
        let padded = isects.next_multiple_of(PART_ALIGNMENT);
        let records = gpu.room::<f32>(name, slopes.max(widths.iter().sum::<usize>() * padded))?;
        let array = |begin: usize, width: usize| records.part(begin..begin + width * isects);
        Ok(Records {
            ssim_slope: records.part(0..slopes).cast(),
            d_shape_from_source: array(0, widths[0]).cast(),
            d_tone_from_source: array(widths[0] * padded, widths[1]).cast(),
            d_rest_from_source: array((widths[0] + widths[1]) * padded, widths[2]),
        })
    }

    /// Of the slopes, only what they need beyond the records counts as theirs.
    fn needs(name: &'static str, purpose: Purpose, (capacity, outputs): Self::Size) -> Vec<Need> {
        let width: usize = record_widths(outputs).iter().sum();
        let records = width * capacity.isects.next_multiple_of(PART_ALIGNMENT);
        let slopes = (9 * capacity.pixels).saturating_sub(records);
        vec![
            Need::new(name, purpose, 4, records),
            Need::new("ssim_slope", Purpose::Pixels, 4, slopes),
        ]
    }
}
