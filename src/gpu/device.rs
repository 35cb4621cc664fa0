//! The shared state behind a [`Gpu`]: device, queue, memory.

use super::caps::Caps;
use super::create::GpuOptions;
use super::debug::Messages;
use crate::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{
    Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc,
};
use std::mem::ManuallyDrop;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A Vulkan device. Clones are cheap and share it; it goes when the last one, and the last buffer, does.
#[derive(Clone)]
pub struct Gpu(pub(super) Arc<Shared>);

/// Who made the device.
pub(super) enum Ownership {
    /// We did, and destroy it.
    Ours {
        /// Keeps the loader's library open.
        #[allow(dead_code, reason = "held, so that the library stays loaded")]
        entry: ash::Entry,
        messages: Box<Messages>,
        messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    },
    /// A host did, and it survives us.
    Hosts,
}

/// The allocator, our own or the host's.
pub(super) type SharedAllocator = Arc<Mutex<Allocator>>;

pub(super) struct Shared {
    pub(super) instance: ash::Instance,
    pub(super) device: ash::Device,
    pub(super) caps: Caps,
    pub(super) family: u32,
    /// None for a guest that was given no queue.
    queue: Option<Mutex<vk::Queue>>,
    allocator: ManuallyDrop<SharedAllocator>,
    ownership: Ownership,
    pub(super) poison: bool,
    memory_limit: u64,
    memory: AtomicU64,
    memory_peak: AtomicU64,
}

/// Turns a Vulkan result into ours.
pub(super) fn check<T>(call: &'static str, result: ash::prelude::VkResult<T>) -> Result<T> {
    result.map_err(|code| Error::Vulkan {
        call,
        result: format!("{code:?}"),
    })
}

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Gpu({})", self.0.caps.name)
    }
}

impl Gpu {
    /// What the device can do.
    pub fn caps(&self) -> &Caps {
        &self.0.caps
    }

    /// Bytes that buffers and images take now.
    pub fn memory_in_use(&self) -> u64 {
        self.0.memory.load(Ordering::Relaxed)
    }

    /// The most bytes they ever took.
    pub fn memory_peak(&self) -> u64 {
        self.0.memory_peak.load(Ordering::Relaxed)
    }

    /// Bytes that buffers may take in all: the user's limit, or the device's largest heap.
    pub fn memory_limit(&self) -> u64 {
        self.0.memory_limit
    }

    /// What the validation layer has said so far; empty is good. A host's device reports to the host.
    pub fn validation_messages(&self) -> Vec<String> {
        match &self.0.ownership {
            Ownership::Ours { messages, .. } => messages.all(),
            Ownership::Hosts => Vec::new(),
        }
    }

    /// Waits until the device has nothing left to do.
    pub fn wait_idle(&self) -> Result<()> {
        let _queue = self.0.queue()?;
        // SAFETY: the queue is locked, so no other thread submits to it meanwhile.
        check("vkDeviceWaitIdle", unsafe {
            self.0.device.device_wait_idle()
        })
    }
}

impl Shared {
    #[allow(clippy::too_many_arguments, reason = "each argument is a field")]
    pub(super) fn assemble(
        instance: ash::Instance,
        physical: vk::PhysicalDevice,
        device: ash::Device,
        caps: Caps,
        family: u32,
        queue: Option<vk::Queue>,
        allocator: Option<SharedAllocator>,
        ownership: Ownership,
        options: &GpuOptions,
    ) -> Result<Gpu> {
        let allocator = match allocator {
            Some(shared) => shared,
            None => Arc::new(Mutex::new(
                Allocator::new(&AllocatorCreateDesc {
                    instance: instance.clone(),
                    device: device.clone(),
                    physical_device: physical,
                    debug_settings: Default::default(),
                    buffer_device_address: false,
                    allocation_sizes: Default::default(),
                })
                .map_err(|error| Error::Unsupported {
                    what: format!("device memory: {error}"),
                })?,
            )),
        };
        let memory_limit = options.memory_limit.unwrap_or(caps.heap);
        Ok(Gpu(Arc::new(Shared {
            instance,
            device,
            caps,
            family,
            queue: queue.map(Mutex::new),
            allocator: ManuallyDrop::new(allocator),
            ownership,
            poison: options.validation,
            memory_limit,
            memory: AtomicU64::new(0),
            memory_peak: AtomicU64::new(0),
        })))
    }

    /// The queue, held against other threads.
    pub(super) fn queue(&self) -> Result<MutexGuard<'_, vk::Queue>> {
        match &self.queue {
            Some(queue) => Ok(queue.lock().unwrap_or_else(PoisonError::into_inner)),
            None => Err(Error::Unsupported {
                what: "submitting: this device was adopted without a queue".into(),
            }),
        }
    }

    pub(super) fn has_queue(&self) -> bool {
        self.queue.is_some()
    }

    /// Memory for a resource of ours, counted against the limit.
    pub(super) fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
    ) -> Result<Allocation> {
        let wanted = requirements.size;
        let before = self.memory.fetch_add(wanted, Ordering::Relaxed);
        let available = self.memory_limit.saturating_sub(before);
        let refuse = || {
            self.memory.fetch_sub(wanted, Ordering::Relaxed);
            Error::OutOfMemory {
                name: name.to_owned(),
                wanted,
                available,
            }
        };
        if wanted > available {
            return Err(refuse());
        }
        let desc = AllocationCreateDesc {
            name,
            requirements,
            location,
            linear: true,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let mut allocator = self
            .allocator
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let allocation = allocator.allocate(&desc).map_err(|_| refuse())?;
        self.memory_peak
            .fetch_max(before + wanted, Ordering::Relaxed);
        Ok(allocation)
    }

    /// Gives memory back; `size` is what `allocate` was asked for.
    pub(super) fn free(&self, allocation: Allocation, size: u64) {
        let mut allocator = self
            .allocator
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        // Freeing fails only for an allocation of another allocator, which this never is.
        let _ = allocator.free(allocation);
        self.memory.fetch_sub(size, Ordering::Relaxed);
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // SAFETY: dropped once, here, before the device whose memory it holds.
        unsafe { ManuallyDrop::drop(&mut self.allocator) };
        if let Ownership::Ours { messenger, .. } = &self.ownership {
            // SAFETY: every resource holds the `Gpu`, so none is left, and nothing runs.
            unsafe { self.device.destroy_device(None) };
            if let Some((utils, messenger)) = messenger {
                // SAFETY: made from this instance, destroyed once.
                unsafe { utils.destroy_debug_utils_messenger(*messenger, None) };
            }
            // SAFETY: the device was the last thing made from it.
            unsafe { self.instance.destroy_instance(None) };
        }
    }
}
