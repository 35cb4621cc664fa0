//! Blocking transfers and one-shot submissions, for set-up, work between frames, and tests.

use super::buffer::Buffer;
use super::device::Gpu;
use super::frame::Frames;
use super::recorder::Recorder;
use crate::Result;
use bytemuck::Pod;
use std::ops::Range;

/// Maximum bytes moved per submission; bounds the staging memory.
pub const TRANSFER_BYTES: usize = 32 << 20;

impl Gpu {
    /// Records, submits and waits.
    pub fn run(&self, record: impl FnOnce(&mut Recorder<'_>)) -> Result<()> {
        let mut frames = Frames::new(self, 1, false)?;
        let (ticket, ()) = frames.submit(|rec| {
            record(rec);
            Ok(())
        })?;
        frames.wait(ticket)
    }

    /// Writes `data` into a buffer from element `at` on, and waits.
    pub fn upload<T: Pod>(&self, buffer: &Buffer<T>, at: usize, data: &[T]) -> Result<()> {
        let step = (TRANSFER_BYTES / size_of::<T>()).max(1);
        for (i, piece) in data.chunks(step).enumerate() {
            self.run(|rec| rec.update(buffer, at + i * step, piece))?;
        }
        Ok(())
    }

    /// A new buffer that holds `data`.
    pub fn buffer_from<T: Pod>(&self, name: &str, data: &[T]) -> Result<Buffer<T>> {
        let buffer = self.buffer(name, data.len())?;
        self.upload(&buffer, 0, data)?;
        Ok(buffer)
    }

    /// Reads a range of a buffer, and waits.
    pub fn download<T: Pod>(&self, buffer: &Buffer<T>, range: Range<usize>) -> Result<Vec<T>> {
        let step = (TRANSFER_BYTES / size_of::<T>()).max(1);
        let mut all = Vec::with_capacity(range.len());
        let mut frames = Frames::new(self, 1, false)?;
        for start in range.clone().step_by(step) {
            let (ticket, piece) = frames.submit(|rec| rec.read_back(buffer, start..range.end.min(start + step)))?;
            frames.wait(ticket)?;
            all.extend(piece.get());
        }
        Ok(all)
    }
}
