//! The replay of a frame's bands: what gradients need to meet them again, the farthest first.
//!
//! A frame in bands has room for the lists of one band only, so that each is listed once more. A splat's (splat,
//! tile) pairs are all of one band, and pixels are handed from band to band as they are, so that gradients in bands
//! have the very bits of those in one go.

use super::depth_bands::DepthBands;
use super::forward::Forward;
use super::scratch::{Capacity, Scratch};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::layout::{COUNT_BAND_BASE, COUNT_BAND_BEGIN, NOT_LISTED};

/// Words that say which splats a band holds: `COUNT_BAND_BEGIN` to `COUNT_BAND_BASE`.
const OFFSETS: usize = (COUNT_BAND_BASE + 1 - COUNT_BAND_BEGIN) as usize;

/// What each band of a frame has left.
#[derive(Clone, Debug)]
pub(crate) struct BandReplay {
    /// Where each begins and ends.
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

    /// Keeps what the band that was composited last has left.
    pub(super) fn keep(&self, rec: &mut Recorder<'_>, s: &Scratch, band: usize) {
        let marks = COUNT_BAND_BEGIN as usize..COUNT_BAND_BASE as usize + 1;
        rec.copy(&s.counts, marks, &self.marks, OFFSETS * band);
        let ends = &self.isect_end_from_pixel[band];
        rec.copy(&s.isect_end_from_pixel, 0..ends.len(), ends, 0);
    }

    /// Where the pixels ended in a band.
    pub(crate) fn isect_end_from_pixel(&self, band: u32) -> &Buffer<u32> {
        &self.isect_end_from_pixel[band as usize]
    }
}

impl Forward {
    /// Lists a band of the frame that was recorded last once more; splats of others begin at `NOT_LISTED` then.
    pub(crate) fn relist(
        &self,
        rec: &mut Recorder<'_>,
        s: &Scratch,
        replay: &BandReplay,
        tiles: usize,
        (band, bands): (u32, DepthBands),
    ) {
        let marks = OFFSETS * band as usize..OFFSETS * (band as usize + 1);
        rec.copy(&replay.marks, marks, &s.counts, COUNT_BAND_BEGIN as usize);
        rec.fill(&s.emitted_from_splat, NOT_LISTED);
        self.list_band(rec, s, tiles, 2, (band, bands));
    }
}
