//! Typed arrays on the device.

use super::check::check;
use super::device::Gpu;
use crate::{Error, Result};
use ash::vk;
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

/// Alignment of the begin of a bound part of a buffer, in elements of four bytes or a multiple: at most 256 bytes on
/// every device (`minStorageBufferOffsetAlignment`; Vulkan specification, table of required limits).
pub const PART_ALIGNMENT: usize = 64;

/// A Vulkan buffer with its memory; destroyed with the last handle and the last frame using it.
pub(super) struct RawBuffer {
    gpu: Gpu,
    pub(super) handle: vk::Buffer,
    pub(super) bytes: u64,
    name: String,
    allocation: Option<Allocation>,
    memory: u64,
}

impl RawBuffer {
    pub(super) fn new(gpu: &Gpu, name: &str, bytes: u64, location: MemoryLocation) -> Result<Arc<RawBuffer>> {
        let bytes = bytes.max(4).next_multiple_of(4);
        let available = gpu.caps().max_allocation;
        if bytes > available {
            return Err(Error::OutOfMemory {
                name: name.to_owned(),
                wanted: bytes,
                available,
            });
        }
        use vk::BufferUsageFlags as Usage;
        let info = vk::BufferCreateInfo::default()
            .size(bytes)
            .usage(Usage::STORAGE_BUFFER | Usage::INDIRECT_BUFFER | Usage::TRANSFER_SRC | Usage::TRANSFER_DST);
        gpu.0.creating("vkCreateBuffer")?;
        let device = &gpu.0.device;
        // SAFETY: a plain buffer within the device's limits.
        let handle = check("vkCreateBuffer", unsafe { device.create_buffer(&info, None) })?;
        gpu.0.names.name(handle, name);
        let mut raw = RawBuffer {
            gpu: gpu.clone(),
            handle,
            bytes,
            name: name.to_owned(),
            allocation: None,
            memory: 0,
        };
        // SAFETY: the handle was just made.
        let requirements = unsafe { device.get_buffer_memory_requirements(handle) };
        let allocation = gpu.0.allocate(name, requirements, location, true)?;
        // SAFETY: memory from our allocator, as required, bound once.
        let bound = unsafe { device.bind_buffer_memory(handle, allocation.memory(), allocation.offset()) };
        raw.allocation = Some(allocation);
        raw.memory = requirements.size;
        gpu.0.creating("vkBindBufferMemory")?;
        check("vkBindBufferMemory", bound)?;
        Ok(Arc::new(raw))
    }

    /// Bytes of a host-visible buffer.
    pub(super) fn mapped(&self) -> &[u8] {
        let all = self.allocation.as_ref().and_then(Allocation::mapped_slice);
        let all = all.unwrap_or_default();
        &all[..all.len().min(self.bytes as usize)]
    }

    /// Writes into a host-visible buffer.
    pub(super) fn write(&self, offset: usize, data: &[u8]) {
        assert!(
            offset + data.len() <= self.bytes as usize,
            "write past the end of {}",
            self.name
        );
        let mapped = self.allocation.as_ref().and_then(Allocation::mapped_ptr);
        let Some(mapped) = mapped else {
            panic!("{} is not host-visible", self.name)
        };
        // SAFETY: in bounds (asserted), and the frame's `Chunks` hand out disjoint ranges that no command reads before
        // they are submitted.
        unsafe {
            std::ptr::copy_nonoverlapping(data.as_ptr(), mapped.as_ptr().cast::<u8>().add(offset), data.len());
        }
    }
}

impl Drop for RawBuffer {
    fn drop(&mut self) {
        // SAFETY: frames that use a buffer hold it, so no command refers to it any more.
        unsafe { self.gpu.0.device.destroy_buffer(self.handle, None) };
        if let Some(allocation) = self.allocation.take() {
            self.gpu.0.free(allocation, &self.name, self.memory);
        }
    }
}

/// Array of `len` elements of `T` on the device, with a name for messages. Clones and parts share the memory.
pub struct Buffer<T> {
    pub(super) raw: Arc<RawBuffer>,
    /// Byte offset in `raw`.
    pub(super) offset: u64,
    len: usize,
    element: PhantomData<fn() -> T>,
}

impl<T> Clone for Buffer<T> {
    fn clone(&self) -> Buffer<T> {
        self.view(self.offset, self.len)
    }
}

impl<T> Buffer<T> {
    /// The same memory from another byte offset and as other elements.
    fn view<U>(&self, offset: u64, len: usize) -> Buffer<U> {
        Buffer {
            raw: self.raw.clone(),
            offset,
            len,
            element: PhantomData,
        }
    }
}

impl<T> std::fmt::Debug for Buffer<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Buffer({}, {} elements)", self.raw.name, self.len)
    }
}

impl<T: Pod> Buffer<T> {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True for a length of 0.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// True for memory of this device.
    pub fn is_on(&self, gpu: &Gpu) -> bool {
        Arc::ptr_eq(&self.raw.gpu.0, &gpu.0)
    }

    /// Name in messages.
    pub fn name(&self) -> &str {
        &self.raw.name
    }

    /// Size in bytes.
    pub fn bytes(&self) -> u64 {
        (self.len * size_of::<T>()) as u64
    }

    /// Bytes covered by a binding of the buffer: whole words, at least one.
    pub(super) fn reach(&self) -> u64 {
        self.bytes().max(4).next_multiple_of(4)
    }

    /// A range of elements as a buffer of its own. Barriers apply to the whole buffer. A part that is bound to a kernel
    /// must begin at a multiple of [`PART_ALIGNMENT`] elements.
    pub fn part(&self, range: Range<usize>) -> Buffer<T> {
        assert!(
            range.start <= range.end && range.end <= self.len,
            "{self:?} has no part {range:?}"
        );
        self.view(self.offset + (range.start * size_of::<T>()) as u64, range.len())
    }

    /// The same bytes as elements of type `U`; a partial last element is dropped.
    pub fn cast<U: Pod>(&self) -> Buffer<U> {
        self.view(self.offset, self.len * size_of::<T>() / size_of::<U>())
    }
}

impl Gpu {
    /// Device-local array. Its contents are undefined; with validation they are NaNs, so that reads before the first
    /// write show.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] beyond the memory limit, the device's memory or the range of one binding.
    pub fn buffer<T: Pod>(&self, name: &str, len: usize) -> Result<Buffer<T>> {
        let bytes = len.checked_mul(size_of::<T>()).unwrap_or(usize::MAX / 2) as u64;
        self.check_reach(name, bytes)?;
        self.room(name, len)
    }

    /// Checks a size in bytes against the range of one binding, the limit of arrays bound to kernels.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] for more bytes.
    pub fn check_reach(&self, name: &str, bytes: u64) -> Result<()> {
        let available = self.caps().reach();
        match bytes <= available {
            true => Ok(()),
            false => Err(Error::OutOfMemory {
                name: name.to_owned(),
                wanted: bytes,
                available,
            }),
        }
    }

    /// As [`Gpu::buffer`], for an array of which only parts are bound to kernels: it may exceed the range of a binding.
    /// The caller checks the parts ([`Gpu::check_reach`]).
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] beyond the memory limit or the device's memory.
    pub fn room<T: Pod>(&self, name: &str, len: usize) -> Result<Buffer<T>> {
        let bytes = len.checked_mul(size_of::<T>()).unwrap_or(usize::MAX / 2) as u64;
        let raw = RawBuffer::new(self, name, bytes, MemoryLocation::GpuOnly)?;
        let buffer = Buffer {
            raw,
            offset: 0,
            len,
            element: PhantomData,
        };
        if self.0.poison && self.0.has_queue() {
            self.run(|rec| rec.fill(&buffer, 0x7FC0_DEAD))?;
        }
        Ok(buffer)
    }
}
