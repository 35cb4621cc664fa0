//! Watch on a device's functions: counts those that submit, wait, create, allocate, map, bind and free, fails one of
//! them, and keeps or leaves out barriers.

use ash::vk;
use std::cell::{Cell, RefCell};
use std::ffi::{CStr, c_void};

thread_local! {
    static CALLS: RefCell<Vec<&'static str>> = const { RefCell::new(Vec::new()) };
    /// Creations until one fails; 0: none will.
    static UNTIL_FAILURE: Cell<u64> = const { Cell::new(0) };
    static BARRIERS: RefCell<Barriers> = const { RefCell::new(Barriers::NONE) };
    static CACHES: RefCell<Vec<vk::PipelineCache>> = const { RefCell::new(Vec::new()) };
    static BUDGET: Cell<u64> = const { Cell::new(0) };
}

/// Scopes of a barrier, of memory or of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Barrier {
    pub(crate) from: (vk::PipelineStageFlags2, vk::AccessFlags2),
    pub(crate) to: (vk::PipelineStageFlags2, vk::AccessFlags2),
    pub(crate) is_of_image: bool,
}

struct Barriers {
    kept: Vec<Barrier>,
    is_keeping: bool,
    /// Index of the barrier that is not recorded.
    left_out: Option<usize>,
}

impl Barriers {
    const NONE: Barriers = Barriers {
        kept: Vec::new(),
        is_keeping: false,
        left_out: None,
    };
}

/// Watched calls of this thread since the previous call of this function.
pub(crate) fn calls() -> Vec<&'static str> {
    CALLS.take()
}

/// Fails the `n`-th creation, allocation, mapping or binding of this thread from here on as out of device memory.
pub(crate) fn fail_creation(n: u64) {
    UNTIL_FAILURE.set(n);
}

/// Creations until the failure; 0 if it has happened.
pub(crate) fn creations_left() -> u64 {
    UNTIL_FAILURE.get()
}

/// Begins to keep barriers; leaves out the one of that index.
pub(crate) fn keep_barriers(left_out: Option<usize>) {
    BARRIERS.set(Barriers {
        kept: Vec::new(),
        is_keeping: true,
        left_out,
    });
}

/// The barriers since `keep_barriers`, in order.
pub(crate) fn barriers() -> Vec<Barrier> {
    BARRIERS.with_borrow_mut(|barriers| {
        barriers.is_keeping = false;
        std::mem::take(&mut barriers.kept)
    })
}

/// Caches of the compute pipelines created since the previous call of this function.
pub(crate) fn pipeline_caches() -> Vec<vk::PipelineCache> {
    CACHES.take()
}

/// Counts a creation; true if it has to fail.
fn is_due(name: &str) -> bool {
    let creates = ["vkCreate", "vkAllocate", "vkMap", "vkBind"];
    if !creates.iter().any(|prefix| name.starts_with(prefix)) {
        return false;
    }
    let left = UNTIL_FAILURE.get();
    UNTIL_FAILURE.set(left.saturating_sub(1));
    left == 1
}

type Callbacks<'a> = *const vk::AllocationCallbacks<'a>;

macro_rules! watch {
    ($($name:ident, $pfn:ty, ($($arg:ident: $kind:ty),*), $failed:tt;)*) => {
        #[allow(
            non_upper_case_globals,
            unreachable_pub,
            reason = "named as what they stand for, in a module that a macro writes"
        )]
        mod original {
            use super::*;
            thread_local! {
                $(pub static $name: Cell<Option<$pfn>> = const { Cell::new(None) };)*
                pub static vkCmdPipelineBarrier2: Cell<Option<vk::PFN_vkCmdPipelineBarrier2>> =
                    const { Cell::new(None) };
                pub static vkCreateComputePipelines: Cell<Option<vk::PFN_vkCreateComputePipelines>> =
                    const { Cell::new(None) };
            }
        }

        $(
            #[allow(non_snake_case, reason = "named as what it stands for")]
            unsafe extern "system" fn $name($($arg: $kind),*) -> Returned!($failed) {
                CALLS.with_borrow_mut(|calls| calls.push(stringify!($name)));
                if is_due(stringify!($name)) {
                    fail!($failed);
                }
                let forward = original::$name.get().expect("the device was made in this thread");
                // SAFETY: the caller upholds the contract of the forwarded function.
                unsafe { forward($($arg),*) }
            }
        )*

        /// The replacement of the function of that name if it is watched, else `function`.
        fn instead(name: &CStr, function: *const c_void) -> *const c_void {
            match name.to_str() {
                $(Ok(stringify!($name)) => {
                    // SAFETY: the loader's function of this name, or null, which is None.
                    let forward = unsafe {
                        std::mem::transmute::<*const c_void, Option<$pfn>>(function)
                    };
                    original::$name.set(forward);
                    $name as *const c_void
                })*
                Ok("vkCmdPipelineBarrier2") => {
                    // SAFETY: as above.
                    let forward = unsafe {
                        std::mem::transmute::<*const c_void, Option<vk::PFN_vkCmdPipelineBarrier2>>(function)
                    };
                    original::vkCmdPipelineBarrier2.set(forward);
                    barrier as *const c_void
                }
                Ok("vkCreateComputePipelines") => {
                    // SAFETY: as above.
                    let forward = unsafe {
                        std::mem::transmute::<*const c_void, Option<vk::PFN_vkCreateComputePipelines>>(function)
                    };
                    original::vkCreateComputePipelines.set(forward);
                    create_pipelines as *const c_void
                }
                _ => function,
            }
        }
    };
}

/// Type of a function's result by its value in case of failure.
macro_rules! Returned {
    (()) => {
        ()
    };
    (OUT) => {
        vk::Result
    };
}

/// End of a function that fails.
macro_rules! fail {
    (()) => {
        return
    };
    (OUT) => {
        return OUT
    };
}

const OUT: vk::Result = vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;

unsafe extern "system" fn barrier(commands: vk::CommandBuffer, info: *const vk::DependencyInfo<'_>) {
    // SAFETY: the caller's structure and its arrays.
    let (memory, images) = unsafe {
        let info = &*info;
        let memory = (info.p_memory_barriers, info.memory_barrier_count as usize);
        let images = (info.p_image_memory_barriers, info.image_memory_barrier_count as usize);
        let memory = if memory.1 == 0 {
            &[]
        } else {
            std::slice::from_raw_parts(memory.0, memory.1)
        };
        let images = if images.1 == 0 {
            &[]
        } else {
            std::slice::from_raw_parts(images.0, images.1)
        };
        (memory, images)
    };
    let is_left_out = BARRIERS.with_borrow_mut(|barriers| {
        if !barriers.is_keeping {
            return false;
        }
        let index = barriers.kept.len();
        barriers.kept.extend(memory.iter().map(|b| Barrier {
            from: (b.src_stage_mask, b.src_access_mask),
            to: (b.dst_stage_mask, b.dst_access_mask),
            is_of_image: false,
        }));
        barriers.kept.extend(images.iter().map(|b| Barrier {
            from: (b.src_stage_mask, b.src_access_mask),
            to: (b.dst_stage_mask, b.dst_access_mask),
            is_of_image: true,
        }));
        assert_eq!(barriers.kept.len(), index + 1, "one barrier a call");
        barriers.left_out == Some(index)
    });
    let forward = original::vkCmdPipelineBarrier2
        .get()
        .expect("the device was made in this thread");
    if !is_left_out {
        // SAFETY: the caller upholds the contract of the forwarded function.
        unsafe { forward(commands, info) };
    }
}

unsafe extern "system" fn create_pipelines(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::ComputePipelineCreateInfo<'_>,
    callbacks: Callbacks<'_>,
    pipelines: *mut vk::Pipeline,
) -> vk::Result {
    CALLS.with_borrow_mut(|calls| calls.push("vkCreateComputePipelines"));
    CACHES.with_borrow_mut(|caches| caches.push(cache));
    if is_due("vkCreateComputePipelines") {
        return OUT;
    }
    let forward = original::vkCreateComputePipelines
        .get()
        .expect("the device was made in this thread");
    // SAFETY: the caller upholds the contract of the forwarded function.
    unsafe { forward(device, cache, count, infos, callbacks, pipelines) }
}

watch! {
    vkQueueSubmit, vk::PFN_vkQueueSubmit,
        (queue: vk::Queue, count: u32, submits: *const vk::SubmitInfo<'_>, fence: vk::Fence), OUT;
    vkQueueSubmit2, vk::PFN_vkQueueSubmit2,
        (queue: vk::Queue, count: u32, submits: *const vk::SubmitInfo2<'_>, fence: vk::Fence), OUT;
    vkQueueWaitIdle, vk::PFN_vkQueueWaitIdle, (queue: vk::Queue), OUT;
    vkDeviceWaitIdle, vk::PFN_vkDeviceWaitIdle, (device: vk::Device), OUT;
    vkWaitSemaphores, vk::PFN_vkWaitSemaphores,
        (device: vk::Device, info: *const vk::SemaphoreWaitInfo<'_>, timeout: u64), OUT;
    vkWaitForFences, vk::PFN_vkWaitForFences,
        (device: vk::Device, count: u32, fences: *const vk::Fence, all: vk::Bool32, timeout: u64), OUT;
    vkAllocateMemory, vk::PFN_vkAllocateMemory,
        (device: vk::Device, info: *const vk::MemoryAllocateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::DeviceMemory), OUT;
    vkMapMemory, vk::PFN_vkMapMemory,
        (device: vk::Device, memory: vk::DeviceMemory, offset: vk::DeviceSize, size: vk::DeviceSize,
         flags: vk::MemoryMapFlags, data: *mut *mut c_void), OUT;
    vkBindBufferMemory, vk::PFN_vkBindBufferMemory,
        (device: vk::Device, buffer: vk::Buffer, memory: vk::DeviceMemory, offset: vk::DeviceSize), OUT;
    vkBindImageMemory, vk::PFN_vkBindImageMemory,
        (device: vk::Device, image: vk::Image, memory: vk::DeviceMemory, offset: vk::DeviceSize), OUT;
    vkCreateBuffer, vk::PFN_vkCreateBuffer,
        (device: vk::Device, info: *const vk::BufferCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::Buffer), OUT;
    vkCreateImage, vk::PFN_vkCreateImage,
        (device: vk::Device, info: *const vk::ImageCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::Image), OUT;
    vkCreateImageView, vk::PFN_vkCreateImageView,
        (device: vk::Device, info: *const vk::ImageViewCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::ImageView), OUT;
    vkCreateSampler, vk::PFN_vkCreateSampler,
        (device: vk::Device, info: *const vk::SamplerCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::Sampler), OUT;
    vkCreateShaderModule, vk::PFN_vkCreateShaderModule,
        (device: vk::Device, info: *const vk::ShaderModuleCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::ShaderModule), OUT;
    vkCreatePipelineLayout, vk::PFN_vkCreatePipelineLayout,
        (device: vk::Device, info: *const vk::PipelineLayoutCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::PipelineLayout), OUT;
    vkCreateDescriptorSetLayout, vk::PFN_vkCreateDescriptorSetLayout,
        (device: vk::Device, info: *const vk::DescriptorSetLayoutCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::DescriptorSetLayout), OUT;
    vkCreateDescriptorPool, vk::PFN_vkCreateDescriptorPool,
        (device: vk::Device, info: *const vk::DescriptorPoolCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::DescriptorPool), OUT;
    vkAllocateDescriptorSets, vk::PFN_vkAllocateDescriptorSets,
        (device: vk::Device, info: *const vk::DescriptorSetAllocateInfo<'_>, made: *mut vk::DescriptorSet), OUT;
    vkCreateCommandPool, vk::PFN_vkCreateCommandPool,
        (device: vk::Device, info: *const vk::CommandPoolCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::CommandPool), OUT;
    vkAllocateCommandBuffers, vk::PFN_vkAllocateCommandBuffers,
        (device: vk::Device, info: *const vk::CommandBufferAllocateInfo<'_>, made: *mut vk::CommandBuffer), OUT;
    vkCreateSemaphore, vk::PFN_vkCreateSemaphore,
        (device: vk::Device, info: *const vk::SemaphoreCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::Semaphore), OUT;
    vkCreateQueryPool, vk::PFN_vkCreateQueryPool,
        (device: vk::Device, info: *const vk::QueryPoolCreateInfo<'_>, callbacks: Callbacks<'_>,
         made: *mut vk::QueryPool), OUT;
    vkFreeMemory, vk::PFN_vkFreeMemory,
        (device: vk::Device, memory: vk::DeviceMemory, callbacks: Callbacks<'_>), ();
    vkUnmapMemory, vk::PFN_vkUnmapMemory, (device: vk::Device, memory: vk::DeviceMemory), ();
    vkDestroyShaderModule, vk::PFN_vkDestroyShaderModule,
        (device: vk::Device, module: vk::ShaderModule, callbacks: Callbacks<'_>), ();
    vkDestroyBuffer, vk::PFN_vkDestroyBuffer,
        (device: vk::Device, buffer: vk::Buffer, callbacks: Callbacks<'_>), ();
    vkDestroyImage, vk::PFN_vkDestroyImage,
        (device: vk::Device, image: vk::Image, callbacks: Callbacks<'_>), ();
    vkDestroyImageView, vk::PFN_vkDestroyImageView,
        (device: vk::Device, view: vk::ImageView, callbacks: Callbacks<'_>), ();
    vkDestroySampler, vk::PFN_vkDestroySampler,
        (device: vk::Device, sampler: vk::Sampler, callbacks: Callbacks<'_>), ();
    vkDestroyPipeline, vk::PFN_vkDestroyPipeline,
        (device: vk::Device, pipeline: vk::Pipeline, callbacks: Callbacks<'_>), ();
    vkDestroyPipelineLayout, vk::PFN_vkDestroyPipelineLayout,
        (device: vk::Device, layout: vk::PipelineLayout, callbacks: Callbacks<'_>), ();
    vkDestroyDescriptorSetLayout, vk::PFN_vkDestroyDescriptorSetLayout,
        (device: vk::Device, layout: vk::DescriptorSetLayout, callbacks: Callbacks<'_>), ();
    vkDestroyDescriptorPool, vk::PFN_vkDestroyDescriptorPool,
        (device: vk::Device, pool: vk::DescriptorPool, callbacks: Callbacks<'_>), ();
    vkDestroySemaphore, vk::PFN_vkDestroySemaphore,
        (device: vk::Device, semaphore: vk::Semaphore, callbacks: Callbacks<'_>), ();
}

/// The same device with watched functions; for use in this thread only.
pub(crate) fn watched(instance: &ash::Instance, device: &ash::Device) -> ash::Device {
    let load = |name: &CStr| {
        // SAFETY: instance and device are alive; an unknown name gives null.
        let function = unsafe { instance.get_device_proc_addr(device.handle(), name.as_ptr()) };
        // SAFETY: function pointers and data pointers are of one size wherever Vulkan runs.
        let function = unsafe { std::mem::transmute::<vk::PFN_vkVoidFunction, *const c_void>(function) };
        instead(name, function)
    };
    // SAFETY: the functions are the device's own, or forward to them.
    unsafe { ash::Device::load_with(load, device.handle()) }
}

thread_local! {
    static MEMORY_PROPERTIES: Cell<Option<vk::PFN_vkGetPhysicalDeviceMemoryProperties2>> = const { Cell::new(None) };
}

unsafe extern "system" fn memory_properties(
    physical: vk::PhysicalDevice,
    properties: *mut vk::PhysicalDeviceMemoryProperties2<'_>,
) {
    let forward = MEMORY_PROPERTIES.get().expect("the instance was made in this thread");
    // SAFETY: the caller upholds the contract of the forwarded function; its chain has the budget alone, which the
    // driver need not know.
    unsafe {
        let next = std::mem::replace(&mut (*properties).p_next, std::ptr::null_mut());
        forward(physical, properties);
        (*properties).p_next = next;
        let budget = next.cast::<vk::PhysicalDeviceMemoryBudgetPropertiesEXT<'_>>();
        let kind = vk::StructureType::PHYSICAL_DEVICE_MEMORY_BUDGET_PROPERTIES_EXT;
        assert_eq!((*budget).s_type, kind);
        (*budget).heap_usage[0] = 1 << 20;
        (*budget).heap_budget[0] = (1 << 20) + BUDGET.get();
    }
}

/// The same instance with a budget of so many unused bytes in the first heap of its devices.
pub(crate) fn with_budget(entry: &ash::Entry, instance: &ash::Instance, left: u64) -> ash::Instance {
    BUDGET.set(left);
    let load = |name: &CStr| {
        // SAFETY: the instance is alive; an unknown name gives null.
        let function = unsafe { entry.get_instance_proc_addr(instance.handle(), name.as_ptr()) };
        // SAFETY: function pointers and data pointers are of one size wherever Vulkan runs.
        let function = unsafe { std::mem::transmute::<vk::PFN_vkVoidFunction, *const c_void>(function) };
        if name == c"vkGetPhysicalDeviceMemoryProperties2" {
            // SAFETY: the loader's function of this name.
            let forward = unsafe {
                std::mem::transmute::<*const c_void, Option<vk::PFN_vkGetPhysicalDeviceMemoryProperties2>>(function)
            };
            MEMORY_PROPERTIES.set(forward);
            return memory_properties as *const c_void;
        }
        function
    };
    // SAFETY: the functions are the instance's own, or forward to them.
    unsafe { ash::Instance::load_with(load, instance.handle()) }
}
