//! State of a frame's depth bands that the gradient passes read, the farthest band first.
//!
//! A frame in bands has room for the lists of one band only, so that each is listed once more. A splat's (splat,
//! tile) pairs are all of one band, and pixels are handed from band to band as they are, so that gradients in bands
//! have the very bits of those in one go.

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
    /// Begin and end of each band, [`OFFSETS`] words a band.
    marks: Buffer<u32>,
    /// One past the last intersection of each that counted, by pixel.
    isect_end_from_pixel: Vec<Buffer<u32>>,
}

impl BandReplay {
    /// Room for a frame's bands.
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

    /// Copies the marks of a band into the frame's `counts`, for listing its pairs once more.
    pub(super) fn restore(&self, rec: &mut Recorder<'_>, counts: &Buffer<u32>, band: u32) {
        let marks = OFFSETS * band as usize..OFFSETS * (band as usize + 1);
        rec.copy(&self.marks, marks, counts, COUNT_BAND_BEGIN as usize);
    }

    /// Where the pixels ended in a band.
    pub(crate) fn isect_end_from_pixel(&self, band: u32) -> &Buffer<u32> {
        &self.isect_end_from_pixel[band as usize]
    }
}
