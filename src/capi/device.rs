//! Adoption of a host's device.

use super::failure::{AshfallResult, Failure, guard};
use super::memory::{check, read, sized, store};
use super::registry::{AshfallDevice, LiveObject, insert, remove};
use crate::gpu::ash::{self, vk};
use crate::gpu::{Gpu, HostDevice, HostFeatures, HostQueue, MissingStruct, REQUIRED};
use std::ffi::{c_char, c_void};
use vk::{
    Device as VkDevice, Instance as VkInstance, PhysicalDevice as VkPhysicalDevice, PipelineCache as VkPipelineCache,
    Queue as VkQueue, StructureType as VkStructureType,
};

/// Version of this header. Structures and functions are only added to it; another version is another interface.
pub const ASHFALL_HEADER_VERSION: u32 = 1;

/// Flag of AshfallDeviceInfo: the device extension VK_EXT_memory_budget is enabled. Allocations then stay within the
/// budget of the device.
pub const ASHFALL_MEMORY_BUDGET: u32 = 1;
/// Flag of AshfallDeviceInfo: the instance extension VK_EXT_debug_utils is enabled. Objects then have names.
pub const ASHFALL_DEBUG_UTILS: u32 = 2;

/// cbindgen:ignore
#[allow(non_camel_case_types, reason = "the name in vulkan_core.h")]
pub type PFN_vkGetInstanceProcAddr = Option<vk::PFN_vkGetInstanceProcAddr>;

/// A host's device.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct AshfallDeviceInfo {
    /// sizeof(AshfallDeviceInfo).
    pub size: u32,
    /// ASHFALL_HEADER_VERSION.
    pub header_version: u32,
    /// The lesser of the versions that the instance was created for and the device offers (VK_MAKE_API_VERSION).
    pub api_version: u32,
    /// Queue family of the command buffers to record into.
    pub queue_family: u32,
    /// The loader's or a layer's function, from which all others are taken.
    pub get_instance_proc_addr: PFN_vkGetInstanceProcAddr,
    /// Instance of the device.
    pub instance: VkInstance,
    /// The physical device.
    pub physical_device: VkPhysicalDevice,
    /// The device. It outlives everything made from the adopted device.
    pub device: VkDevice,
    /// The pNext chain that the device was created with, for the features that it enables; read during the call only.
    pub created_with: *const c_void,
    /// Queue for blocking uploads, used during ashfall_model_upload only; null for none. No other thread may use it
    /// meanwhile.
    pub queue: VkQueue,
    /// The host's cache for pipelines, which outlives the adopted device; null for none.
    pub pipeline_cache: VkPipelineCache,
    /// Limit of the library's buffers in bytes; 0 for the device's largest heap.
    pub memory_limit: u64,
    /// ASHFALL_MEMORY_BUDGET, ASHFALL_DEBUG_UTILS.
    pub flags: u32,
    /// 0.
    pub reserved: u32,
}

/// A required feature without a structure in a chain.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallMissing {
    /// Name of the feature in the Vulkan specification; valid for good.
    pub feature: *const c_char,
    /// Type of the structure that has this feature alone, for chains without the one of its Vulkan version.
    pub structure: VkStructureType,
}

sized!(AshfallDeviceInfo);

/// Version of the library: major << 22 | minor << 12 | patch.
#[unsafe(no_mangle)]
pub extern "C" fn ashfall_version() -> u32 {
    let number = |text: &str| text.parse::<u32>().unwrap_or(0);
    let (major, minor) = (env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"));
    number(major) << 22 | number(minor) << 12 | number(env!("CARGO_PKG_VERSION_PATCH"))
}

/// Enables the required features in the structures of a pNext chain for vkCreateDevice; no other value is changed.
///
/// `chain`: the first structure of the chain, or null. `missing`: receives the features without a structure in it, up
/// to `*missing_count`, for which structures are to be added; null to ask for their number. `missing_count`: receives
/// their number. Vulkan 1.2 and 1.3 have the structures of all.
///
/// # Safety
/// Every structure of the chain begins with type and next pointer and is valid for writes; `missing` is null or has
/// `*missing_count` elements.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_enable_features(
    chain: *mut c_void,
    missing: *mut AshfallMissing,
    missing_count: *mut u32,
) -> AshfallResult {
    guard(|| {
        check("missing_count", missing_count)?;
        let mut features = vk::PhysicalDeviceFeatures2 {
            p_next: chain,
            ..Default::default()
        };
        // SAFETY: as the caller says.
        let found = unsafe { REQUIRED.enable(&mut features) };
        // SAFETY: not null.
        let room = unsafe { missing_count.replace(found.len() as u32) };
        if missing.is_null() {
            return Ok(());
        }
        for (at, MissingStruct { feature, structure }) in found.iter().enumerate().take(room as usize) {
            let entry = AshfallMissing {
                feature: name(feature),
                structure: *structure,
            };
            // SAFETY: within the array's room.
            unsafe { missing.add(at).write(entry) };
        }
        Ok(())
    })
}

/// Names of features as C has them.
fn name(feature: &str) -> *const c_char {
    const NAMES: [&std::ffi::CStr; 3] = [c"scalarBlockLayout", c"timelineSemaphore", c"synchronization2"];
    let found = NAMES.iter().find(|name| name.to_bytes() == feature.as_bytes());
    found.map_or(c"".as_ptr(), |name| name.as_ptr())
}

/// Adopts a host's device. An error names everything that the device misses.
///
/// # Safety
/// The handles belong together; version, features and extensions are as stated; `device` is null or valid for a write.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_adopt(
    info: *const AshfallDeviceInfo,
    device: *mut *mut AshfallDevice,
) -> AshfallResult {
    guard(|| {
        check("device", device)?;
        // SAFETY: as the caller says.
        let info = unsafe { read(info) }?;
        // SAFETY: as the caller says.
        let gpu = unsafe { adopt(&info) }?;
        // SAFETY: checked above.
        unsafe { store("device", device, insert(LiveObject::Device(gpu))) }
    })
}

/// Adopts a device.
///
/// # Safety
/// As [`ashfall_adopt`].
unsafe fn adopt(info: &AshfallDeviceInfo) -> Result<Gpu, Failure> {
    if info.header_version != ASHFALL_HEADER_VERSION {
        let (wanted, found) = (info.header_version, ASHFALL_HEADER_VERSION);
        let what = format!("header_version: the host has version {wanted}, the library {found}");
        return Err(Failure::argument(what));
    }
    let Some(get_instance_proc_addr) = info.get_instance_proc_addr else {
        return Err(Failure::argument("get_instance_proc_addr: a null pointer"));
    };
    let known = ASHFALL_MEMORY_BUDGET | ASHFALL_DEBUG_UTILS;
    if info.flags & !known != 0 || info.reserved != 0 {
        return Err(Failure::argument(format!("flags: {:#x} has unknown ones", info.flags)));
    }
    for (name, is_null) in [
        ("instance", info.instance == VkInstance::null()),
        ("physical_device", info.physical_device == VkPhysicalDevice::null()),
        ("device", info.device == VkDevice::null()),
    ] {
        if is_null {
            return Err(Failure::argument(format!("{name}: a null handle")));
        }
    }
    let functions = ash::StaticFn { get_instance_proc_addr };
    // SAFETY: the host's instance, by its own loader.
    let instance = unsafe { ash::Instance::load(&functions, info.instance) };
    // SAFETY: a device of the instance.
    let device = unsafe { ash::Device::load(instance.fp_v1_0(), info.device) };
    let chain = vk::PhysicalDeviceFeatures2 {
        p_next: info.created_with.cast_mut(),
        ..Default::default()
    };
    // SAFETY: the chain of the device's creation, which is read.
    let enabled = HostFeatures {
        memory_budget: info.flags & ASHFALL_MEMORY_BUDGET != 0,
        debug_utils: info.flags & ASHFALL_DEBUG_UTILS != 0,
        ..unsafe { HostFeatures::of_chain(&chain) }
    };
    let host = HostDevice {
        instance,
        physical_device: info.physical_device,
        device,
        api_version: info.api_version,
        enabled,
        queue_family: info.queue_family,
        queue: (info.queue != VkQueue::null()).then_some(HostQueue { queue: info.queue }),
        allocator: None,
        memory_limit: (info.memory_limit != 0).then_some(info.memory_limit),
        pipeline_cache: info.pipeline_cache,
    };
    // SAFETY: as the caller says.
    Ok(unsafe { Gpu::adopt(host) }?)
}

/// Destroys an adopted device; null is ignored. Its models and renderers may be destroyed later. The host destroys its
/// VkDevice after all of them, when nothing of theirs runs any more.
#[unsafe(no_mangle)]
pub extern "C" fn ashfall_device_destroy(device: *mut AshfallDevice) -> AshfallResult {
    guard(|| remove(device))
}
