//! Objects owned by one frame in flight.

use super::buffer::RawBuffer;
use super::descriptors::Arena;
use super::device::Gpu;
use super::hazards::Hazards;
use super::timing::Timestamps;
use crate::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::any::Any;
use std::collections::HashSet;
use std::sync::Arc;

/// Linear allocator of host-visible memory; chunks with other holders are not reused.
pub(super) struct Chunks {
    name: &'static str,
    location: MemoryLocation,
    chunks: Vec<Chunk>,
}

struct Chunk {
    raw: Arc<RawBuffer>,
    /// Bytes in use by the frame.
    used: usize,
}

/// Bytes of a chunk of staging or readback memory, unless one piece is larger.
pub const STAGING_BYTES: usize = 1 << 16;

impl Chunks {
    pub(super) fn new(name: &'static str, location: MemoryLocation) -> Chunks {
        Chunks {
            name,
            location,
            chunks: Vec::new(),
        }
    }

    /// Frees all ranges. Drops chunks that a reader still holds, that have more than `most` bytes, or that the last
    /// frame had no use for.
    fn reset(&mut self, most: u64) {
        self.chunks
            .retain(|chunk| Arc::strong_count(&chunk.raw) == 1 && chunk.raw.bytes <= most && chunk.used > 0);
        self.chunks.iter_mut().for_each(|chunk| chunk.used = 0);
    }

    /// Range of `bytes` in a chunk: the chunk and an offset, a multiple of 16.
    pub(super) fn take(&mut self, gpu: &Gpu, bytes: usize) -> Result<(Arc<RawBuffer>, usize)> {
        let fits = |chunk: &Chunk| chunk.used + bytes <= chunk.raw.bytes as usize;
        let index = match self.chunks.iter().position(fits) {
            Some(index) => index,
            None => {
                let size = bytes.max(STAGING_BYTES) as u64;
                let raw = RawBuffer::new(gpu, self.name, size, self.location)?;
                self.chunks.push(Chunk { raw, used: 0 });
                self.chunks.len() - 1
            }
        };
        let chunk = &mut self.chunks[index];
        let offset = chunk.used;
        chunk.used = (offset + bytes).next_multiple_of(16);
        Ok((chunk.raw.clone(), offset))
    }
}

/// One frame in flight.
pub(super) struct FrameSlot {
    pub(super) pool: vk::CommandPool,
    pub(super) commands: vk::CommandBuffer,
    /// Timeline value that signals the end of the slot's last submission.
    pub(super) value: u64,
    pub(super) arena: Arena,
    pub(super) staging: Chunks,
    pub(super) reading: Chunks,
    pub(super) timestamps: Option<Timestamps>,
    pub(super) kept: Vec<Arc<dyn Any + Send + Sync>>,
    pub(super) kept_ids: HashSet<usize>,
    /// Accesses since the last barrier.
    pub(super) hazards: Hazards,
}

impl FrameSlot {
    /// A slot without commands of its own.
    pub(super) fn new(gpu: &Gpu) -> FrameSlot {
        FrameSlot {
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            value: 0,
            arena: Arena::new(gpu),
            staging: Chunks::new("staging", MemoryLocation::CpuToGpu),
            reading: Chunks::new("readback", MemoryLocation::GpuToCpu),
            timestamps: None,
            kept: Vec::new(),
            kept_ids: HashSet::new(),
            hazards: Hazards::default(),
        }
    }

    /// Keeps a resource alive until the slot is reused.
    pub(super) fn keep<K: Any + Send + Sync>(&mut self, used: Arc<K>) {
        if self.kept_ids.insert(Arc::as_ptr(&used).addr()) {
            self.kept.push(used);
        }
    }

    /// Frees everything for the next frame; keeps no staging chunk of more than `most` bytes.
    pub(super) fn reset(&mut self, most: u64) {
        self.kept.clear();
        self.kept_ids.clear();
        self.staging.reset(most);
        self.reading.reset(u64::MAX);
        self.arena.reset();
    }
}
