//! State of a frame's depth bands for the gradient passes, which process the farthest band first.
//!
//! The buffers hold the lists of one band only, so that each band is listed again. All (splat, tile) pairs of a splat
//! are in one band, and pixels pass unchanged from band to band, so that gradients have the same bits as with a single
//! band.

use super::capacity::Capacity;
use super::depth_bands::DepthBands;
use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::layout::{COUNT_BAND_BASE, COUNT_BAND_BEGIN};

/// Words of `counts` that hold a band's range of splats: `COUNT_BAND_BEGIN` to `COUNT_BAND_BASE`.
const OFFSETS: usize = (COUNT_BAND_BASE + 1 - COUNT_BAND_BEGIN) as usize;

/// State of each band of a frame.
#[derive(Clone, Debug)]
pub(crate) struct BandReplay {
    /// `[band][OFFSETS]`: begin, end and base of each band.
    marks: Buffer<u32>,
    /// `[band][pixel]`: one past the last intersection that counted.
    isect_end_from_pixel: Vec<Buffer<u32>>,
}

impl BandReplay {
    /// Buffers for a frame's bands.
    pub(crate) fn new(gpu: &Gpu, capacity: &Capacity, bands: DepthBands) -> Result<BandReplay> {
        let ends = |_| gpu.buffer("isect_end_from_pixel", capacity.pixels);
        Ok(BandReplay {
            marks: gpu.buffer("marks", OFFSETS * bands.count as usize)?,
            isect_end_from_pixel: (0..bands.count).map(ends).collect::<Result<_>>()?,
        })
    }

    /// Copies the state of the band that was composited last from the frame's `counts` and `isect_end_from_pixel`.
    pub(super) fn keep(
        &self,
        rec: &mut Recorder<'_>,
        counts: &Buffer<u32>,
        isect_end_from_pixel: &Buffer<u32>,
        band: usize,
    ) {
        let marks = COUNT_BAND_BEGIN as usize..COUNT_BAND_BASE as usize + 1;
        rec.copy(counts, marks, &self.marks, OFFSETS * band);
        let ends = &self.isect_end_from_pixel[band];
        rec.copy(isect_end_from_pixel, 0..ends.len(), ends, 0);
    }

    /// Copies the range of a band into the frame's `counts`, for listing its pairs again.
    pub(super) fn restore(&self, rec: &mut Recorder<'_>, counts: &Buffer<u32>, band: u32) {
        let marks = OFFSETS * band as usize..OFFSETS * (band as usize + 1);
        rec.copy(&self.marks, marks, counts, COUNT_BAND_BEGIN as usize);
    }

    /// One past the last intersection that counted in a band, by pixel.
    pub(crate) fn isect_end_from_pixel(&self, band: u32) -> &Buffer<u32> {
        &self.isect_end_from_pixel[band as usize]
    }
}
