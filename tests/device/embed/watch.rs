//! Call counter of a device's submitting, waiting and allocating functions, which are the host's to call.

use ash::vk;
use std::cell::{Cell, RefCell};
use std::ffi::{CStr, c_void};

thread_local! {
    static CALLS: RefCell<Vec<&'static str>> = const { RefCell::new(Vec::new()) };
}

/// Watched calls of this thread since the previous call of this function.
pub(crate) fn calls() -> Vec<&'static str> {
    CALLS.take()
}

macro_rules! watch {
    ($($name:ident, $pfn:ty, ($($arg:ident: $kind:ty),*);)*) => {
        #[allow(
            non_upper_case_globals,
            unreachable_pub,
            reason = "named as what they stand for, in a module that a macro writes"
        )]
        mod original {
            use super::*;
            thread_local! {
                $(pub static $name: Cell<Option<$pfn>> = const { Cell::new(None) };)*
            }
        }

        $(
            #[allow(non_snake_case, reason = "named as what it stands for")]
            unsafe extern "system" fn $name($($arg: $kind),*) -> vk::Result {
                CALLS.with_borrow_mut(|calls| calls.push(stringify!($name)));
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
                _ => function,
            }
        }
    };
}

watch! {
    vkQueueSubmit, vk::PFN_vkQueueSubmit,
        (queue: vk::Queue, count: u32, submits: *const vk::SubmitInfo<'_>, fence: vk::Fence);
    vkQueueSubmit2, vk::PFN_vkQueueSubmit2,
        (queue: vk::Queue, count: u32, submits: *const vk::SubmitInfo2<'_>, fence: vk::Fence);
    vkQueueWaitIdle, vk::PFN_vkQueueWaitIdle, (queue: vk::Queue);
    vkDeviceWaitIdle, vk::PFN_vkDeviceWaitIdle, (device: vk::Device);
    vkWaitSemaphores, vk::PFN_vkWaitSemaphores,
        (device: vk::Device, info: *const vk::SemaphoreWaitInfo<'_>, timeout: u64);
    vkWaitForFences, vk::PFN_vkWaitForFences,
        (device: vk::Device, count: u32, fences: *const vk::Fence, all: vk::Bool32, timeout: u64);
    vkAllocateMemory, vk::PFN_vkAllocateMemory,
        (device: vk::Device, info: *const vk::MemoryAllocateInfo<'_>,
         callbacks: *const vk::AllocationCallbacks<'_>, memory: *mut vk::DeviceMemory);
    vkCreateBuffer, vk::PFN_vkCreateBuffer,
        (device: vk::Device, info: *const vk::BufferCreateInfo<'_>,
         callbacks: *const vk::AllocationCallbacks<'_>, buffer: *mut vk::Buffer);
    vkCreateDescriptorPool, vk::PFN_vkCreateDescriptorPool,
        (device: vk::Device, info: *const vk::DescriptorPoolCreateInfo<'_>,
         callbacks: *const vk::AllocationCallbacks<'_>, pool: *mut vk::DescriptorPool);
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
