//! Inputs and buffers of a training step.

use super::config::TrainConfig;
use super::transients::{PATCH_WORDS, PatchGrid};
use crate::Result;
use crate::gpu::{Buffer, Gpu, PART_ALIGNMENT};
use crate::layout::{SURFEL_REST, View};
use crate::render::{Allocate, Capacity, DepthBands, Forward, Need, Purpose, buffers};
use crate::scene::Primitive;

buffers! {
    /// Buffers of a step beyond those of rendering.
    pub(crate) struct Gradients(capacity: Capacity, primitive: Primitive) {
        records: Records, Intersections, (capacity, primitive);
        /// An image of these tiles has at most as many loss tiles as compositing tiles.
        loss_from_tile: Buffer<[f32; 4]>, Pixels, capacity.tiles;
        /// Of the loss, and both sums of the photograph's gains.
        loss: Buffer<[f32; 4]>, Pixels, 3;
        d_image: Buffer<f32>, Pixels, 3 * capacity.pixels;
        /// A bit of each patch that the loss leaves out.
        ignored: Buffer<u32>, Pixels, PATCH_WORDS;
    }
}

/// Words of the gradients of a (splat, tile) pair in each of three arrays.
pub(crate) fn record_widths(primitive: Primitive) -> [usize; 3] {
    match primitive {
        Primitive::Gaussian3d => [4, 4, 1],
        Primitive::Surfel => [4, 4, SURFEL_REST as usize],
    }
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
    type Size = (Capacity, Primitive);

    fn allocate(gpu: &Gpu, name: &str, (capacity, primitive): Self::Size) -> Result<Records> {
        let (slopes, isects) = (9 * capacity.pixels, capacity.isects);
        let widths = record_widths(primitive);
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
    fn needs(name: &'static str, purpose: Purpose, (capacity, primitive): Self::Size) -> Vec<Need> {
        let width: usize = record_widths(primitive).iter().sum();
        let records = width * capacity.isects.next_multiple_of(PART_ALIGNMENT);
        let slopes = (9 * capacity.pixels).saturating_sub(records);
        vec![
            Need::new(name, purpose, 4, records),
            Need::new("ssim_slope", Purpose::Pixels, 4, slopes),
        ]
    }
}

/// Inputs of a step.
pub(crate) struct Step<'a> {
    pub(crate) config: &'a TrainConfig,
    pub(crate) forward: &'a Forward,
    pub(crate) iteration: u32,
    /// Scene extent in world units.
    pub(crate) extent: f64,
    pub(crate) view: &'a View,
    pub(crate) sh_degree: u32,
    pub(crate) bands: DepthBands,
    /// Gains of the photograph, and slopes on the curve's toe.
    pub(crate) exposure: [[f32; 3]; 2],
    /// Patches of the photograph, if the run leaves some out.
    pub(crate) patches: Option<PatchGrid>,
}

/// Exposure of photographs without one.
pub(crate) const UNEXPOSED: [[f32; 3]; 2] = [[1.0; 3]; 2];
