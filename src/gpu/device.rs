//! Shared state of a [`Gpu`]: device, queue, memory.

use super::caps::Caps;
use super::check::check;
use super::compiled::CompiledKernels;
use super::debug::Messages;
use super::faults::Faults;
use super::memory::{MemoryTracker, MemoryUse};
use super::names::Names;
use super::options::GpuOptions;
use crate::{Error, Result};
use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, MemoryLocation};
use std::mem::ManuallyDrop;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A Vulkan device. Clones are cheap and share it; it is destroyed with the last clone and the last buffer.
#[derive(Clone)]
pub struct Gpu(pub(super) Arc<GpuState>);

/// Instance, messenger and loader of an owned device: created before it, destroyed after it.
pub(super) struct Own {
    pub(super) instance: ash::Instance,
    /// At a fixed address, to which the messenger points.
    pub(super) messages: Arc<Messages>,
    pub(super) messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// Keeps the loader's library open.
    pub(super) entry: ash::Entry,
}

impl Drop for Own {
    fn drop(&mut self) {
        if let Some((utils, messenger)) = &self.messenger {
            // SAFETY: made from this instance, destroyed once.
            unsafe { utils.destroy_debug_utils_messenger(*messenger, None) };
        }
        // SAFETY: the device made from it is gone: `GpuState` destroys it before it drops this.
        unsafe { self.instance.destroy_instance(None) };
    }
}

/// The allocator, owned or the host's.
pub(super) type SharedAllocator = Arc<Mutex<Allocator>>;

pub(super) struct GpuState {
    pub(super) device: ash::Device,
    pub(super) caps: Caps,
    pub(super) family: u32,
    instance: ash::Instance,
    physical: vk::PhysicalDevice,
    pub(super) names: Names,
    /// The host's, or owned and destroyed with the device; null on a host's device without one.
    pub(super) pipeline_cache: vk::PipelineCache,
    has_memory_budget: bool,
    /// `None` on a host's device adopted without a queue.
    queue: Option<Mutex<vk::Queue>>,
    allocator: ManuallyDrop<SharedAllocator>,
    /// `None`: the device is a host's and is not destroyed here.
    own: Option<Own>,
    pub(super) poison: bool,
    faults: Option<Faults>,
    memory_limit: u64,
    tracker: Mutex<MemoryTracker>,
    kernels: Mutex<CompiledKernels>,
}

/// Bytes of the blocks shared by small buffers; larger buffers have dedicated blocks, freed with them. The allocator's
/// minimum, so that little memory is reserved unused.
const BLOCK_BYTES: u64 = 4 << 20;

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Gpu({})", self.0.caps.name)
    }
}

impl Gpu {
    /// Capabilities and limits of the device.
    pub fn caps(&self) -> &Caps {
        &self.0.caps
    }

    /// False for a host's device.
    pub(crate) fn is_owned(&self) -> bool {
        self.0.own.is_some()
    }

    /// Bytes of the buffers and images alive.
    pub fn memory_in_use(&self) -> u64 {
        self.0.tracker().bytes
    }

    /// Maximum of [`Gpu::memory_in_use`] since the last reset.
    pub fn memory_peak(&self) -> u64 {
        self.0.tracker().peak_bytes
    }

    /// Peak bytes of the allocator's blocks, unused parts included. With a host's allocator, the host's allocations
    /// count too.
    pub fn memory_reserved_peak(&self) -> u64 {
        self.0.tracker().reserved_peak_bytes
    }

    /// Memory of the buffers of each name, in the order of the names.
    pub fn memory_by_name(&self) -> Vec<(String, MemoryUse)> {
        self.0.tracker().by_name()
    }

    /// Resets the peaks to the current values.
    pub fn reset_memory_peak(&self) {
        let reserved = self.0.allocator().capacity();
        self.0.tracker().reset_peak(reserved);
    }

    /// Limit of [`Gpu::memory_in_use`]: the user's, or the device's largest heap.
    pub fn memory_limit(&self) -> u64 {
        self.0.memory_limit
    }

    /// Warnings and errors of the validation layer so far. Empty for a host's device: its messages go to the host.
    pub fn validation_messages(&self) -> Vec<String> {
        let own = self.0.own.as_ref();
        own.map(|own| own.messages.all()).unwrap_or_default()
    }

    /// Compiled pipelines, for [`GpuOptions::pipeline_cache`] of a later run on this device and driver. Empty for a
    /// host without a cache.
    pub fn pipeline_cache(&self) -> Result<Vec<u8>> {
        let cache = self.0.pipeline_cache;
        if cache == vk::PipelineCache::null() {
            return Ok(Vec::new());
        }
        // SAFETY: the cache is alive.
        let data = unsafe { self.0.device.get_pipeline_cache_data(cache) };
        check("vkGetPipelineCacheData", data)
    }

    /// Waits until the device is idle.
    pub fn wait_idle(&self) -> Result<()> {
        let _queue = self.0.queue()?;
        self.0.using_queue("vkDeviceWaitIdle")?;
        // SAFETY: the queue is locked, so no other thread submits to it meanwhile.
        check("vkDeviceWaitIdle", unsafe { self.0.device.device_wait_idle() })
    }
}

/// Components of a [`Gpu`].
pub(super) struct Parts {
    pub(super) instance: ash::Instance,
    pub(super) physical: vk::PhysicalDevice,
    pub(super) device: ash::Device,
    pub(super) caps: Caps,
    pub(super) family: u32,
    pub(super) queue: Option<vk::Queue>,
    /// `None`: one is created.
    pub(super) allocator: Option<SharedAllocator>,
    /// The host's, or null. An owned device has one of its own.
    pub(super) pipeline_cache: vk::PipelineCache,
    /// True if VK_EXT_memory_budget is enabled.
    pub(super) has_memory_budget: bool,
    /// True if VK_EXT_debug_utils is enabled.
    pub(super) has_debug_utils: bool,
    pub(super) own: Option<Own>,
}

impl Parts {
    pub(super) fn into_gpu(self, options: &GpuOptions) -> Result<Gpu> {
        let allocator = match self.allocator {
            Some(shared) => Ok(shared),
            None => Allocator::new(&AllocatorCreateDesc {
                instance: self.instance.clone(),
                device: self.device.clone(),
                physical_device: self.physical,
                debug_settings: Default::default(),
                buffer_device_address: false,
                allocation_sizes: AllocationSizes::new(BLOCK_BYTES, BLOCK_BYTES),
            })
            .map(|allocator| Arc::new(Mutex::new(allocator))),
        };
        let allocator = allocator.map_err(|error| {
            if self.own.is_some() {
                // SAFETY: the device is owned, and nothing was made from it.
                unsafe { self.device.destroy_device(None) };
            }
            Error::Unsupported {
                what: format!("device memory: {error}"),
            }
        })?;
        let is_own = self.own.is_some();
        let state = GpuState {
            names: Names::new(&self.instance, &self.device, self.has_debug_utils),
            instance: self.instance,
            physical: self.physical,
            pipeline_cache: self.pipeline_cache,
            has_memory_budget: self.has_memory_budget,
            device: self.device,
            memory_limit: options.memory_limit.unwrap_or(self.caps.heap),
            caps: self.caps,
            family: self.family,
            queue: self.queue.map(Mutex::new),
            allocator: ManuallyDrop::new(allocator),
            own: self.own,
            poison: options.validation,
            faults: options.faults.clone(),
            tracker: Mutex::default(),
            kernels: Mutex::default(),
        };
        match is_own {
            true => state.with_pipeline_cache(&options.pipeline_cache),
            false => Ok(state),
        }
        .map(|state| Gpu(Arc::new(state)))
    }
}

impl GpuState {
    /// Creates the pipeline cache of an owned device.
    fn with_pipeline_cache(mut self, data: &[u8]) -> Result<GpuState> {
        let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
        self.creating("vkCreatePipelineCache")?;
        // SAFETY: the data is from an earlier cache, as the options' documentation demands, or empty.
        let cache = unsafe { self.device.create_pipeline_cache(&info, None) };
        self.pipeline_cache = check("vkCreatePipelineCache", cache)?;
        Ok(self)
    }

    /// True if kernels can write images of this format without its declaration.
    pub(super) fn writes_format(&self, format: vk::Format) -> bool {
        use vk::FormatFeatureFlags2 as Feature;
        let needed = Feature::STORAGE_IMAGE | Feature::STORAGE_WRITE_WITHOUT_FORMAT;
        self.format_features(format).contains(needed)
    }

    /// True if kernels can read texels of images of this format.
    pub(super) fn reads_format(&self, format: vk::Format) -> bool {
        let features = self.format_features(format);
        features.contains(vk::FormatFeatureFlags2::SAMPLED_IMAGE)
    }

    fn format_features(&self, format: vk::Format) -> vk::FormatFeatureFlags2 {
        let mut features = vk::FormatProperties3::default();
        let mut properties = vk::FormatProperties2::default().push_next(&mut features);
        // SAFETY: the device belongs to the instance, both of at least Vulkan 1.3.
        unsafe {
            self.instance
                .get_physical_device_format_properties2(self.physical, format, &mut properties);
        }
        features.optimal_tiling_features
    }

    /// Bytes that the driver's budget of the largest device-local heap leaves; unlimited without the extension.
    fn budget_left(&self) -> u64 {
        if !self.has_memory_budget {
            return u64::MAX;
        }
        let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
        let mut memory = vk::PhysicalDeviceMemoryProperties2::default().push_next(&mut budget);
        // SAFETY: the device belongs to the instance and has the extension.
        unsafe {
            self.instance
                .get_physical_device_memory_properties2(self.physical, &mut memory);
        }
        let heaps = memory.memory_properties;
        let heaps = heaps.memory_heaps_as_slice().iter().enumerate();
        let local = heaps.filter(|(_, heap)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        let largest = local.max_by_key(|(_, heap)| heap.size);
        largest.map_or(u64::MAX, |(i, _)| {
            budget.heap_budget[i].saturating_sub(budget.heap_usage[i])
        })
    }

    /// The queue, locked.
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

    fn allocator(&self) -> MutexGuard<'_, Allocator> {
        let shared: &SharedAllocator = &self.allocator;
        shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn kernels(&self) -> MutexGuard<'_, CompiledKernels> {
        self.kernels.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tracker(&self) -> MutexGuard<'_, MemoryTracker> {
        self.tracker.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Injected failure of the creation of an object, for tests; called before it.
    pub(super) fn creating(&self, call: &'static str) -> Result<()> {
        self.faults.as_ref().map_or(Ok(()), |f| f.create(call))
    }

    /// Injected failure of a submission; called before it.
    pub(super) fn submitting(&self) -> Result<()> {
        self.faults.as_ref().map_or(Ok(()), Faults::submit)
    }

    /// Injected failure of other queue calls on a lost device; called before them.
    pub(super) fn using_queue(&self, call: &'static str) -> Result<()> {
        self.faults.as_ref().map_or(Ok(()), |f| f.use_queue(call))
    }

    /// Allocates memory, counted against the limit. `linear`: true for a buffer, false for an image.
    pub(super) fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Allocation> {
        self.creating("vkAllocateMemory")?;
        let wanted = requirements.size;
        // Locked until the end: two threads must not both take the last memory.
        let mut tracker = self.tracker();
        let mut available = self.memory_limit.saturating_sub(tracker.bytes);
        if location == MemoryLocation::GpuOnly {
            available = available.min(self.budget_left());
        }
        let refuse = || Error::OutOfMemory {
            name: name.to_owned(),
            wanted,
            available,
        };
        if wanted > available {
            return Err(refuse());
        }
        let desc = AllocationCreateDesc {
            name,
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let mut allocator = self.allocator();
        let allocation = allocator.allocate(&desc).map_err(|_| refuse())?;
        tracker.take(name, wanted, allocator.capacity());
        Ok(allocation)
    }

    /// Frees memory; `name` and `size` are the arguments of its `allocate`.
    pub(super) fn free(&self, allocation: Allocation, name: &str, size: u64) {
        // Freeing fails only for an allocation of another allocator.
        let _ = self.allocator().free(allocation);
        self.tracker().give(name, size);
    }
}

impl Drop for GpuState {
    fn drop(&mut self) {
        for (_, kernel) in self.kernels().drain() {
            // SAFETY: every pipeline and every frame holds the `Gpu`, so none is left.
            unsafe { kernel.destroy(&self.device) };
        }
        // SAFETY: dropped once, here, before the device that its memory belongs to.
        unsafe { ManuallyDrop::drop(&mut self.allocator) };
        if self.own.is_some() {
            // SAFETY: the cache is owned; a null one is ignored.
            unsafe { self.device.destroy_pipeline_cache(self.pipeline_cache, None) };
            // SAFETY: every resource holds the `Gpu`, so none is left, and no commands run.
            unsafe { self.device.destroy_device(None) };
        }
    }
}
