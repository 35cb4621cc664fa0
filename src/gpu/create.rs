//! Creation of an owned Vulkan instance and device.

use super::caps::{Caps, DeviceKind};
use super::check::check;
use super::debug::Messages;
use super::device::{Gpu, Own, Parts};
use super::features::{HostFeatures, missing_texts, refuse_unmet};
use super::options::GpuOptions;
use super::requirements::REQUIRED;
use crate::shader::Requirement;
use crate::{Error, Result};
use ash::vk;
use std::ffi::CStr;
use std::sync::Arc;

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// The Vulkan devices of this machine.
pub fn devices() -> Result<Vec<Caps>> {
    let entry = load()?;
    let instance = create_instance(&entry, None)?;
    let found =
        enumerate(&instance).map(|physical| physical.iter().map(|&device| Caps::query(&instance, device)).collect());
    // SAFETY: nothing made from the instance is left.
    unsafe { instance.destroy_instance(None) };
    found
}

fn load() -> Result<ash::Entry> {
    // SAFETY: the loader is the system's Vulkan library; its initialisers are sound to run.
    unsafe { ash::Entry::load() }.map_err(|error| Error::Unsupported {
        what: format!(
            "no Vulkan loader ({error}); install one and a driver (Debian: libvulkan1 and \
             mesa-vulkan-drivers, or the GPU vendor's)"
        ),
    })
}

fn create_instance(entry: &ash::Entry, messages: Option<&Messages>) -> Result<ash::Instance> {
    let application = vk::ApplicationInfo::default()
        .application_name(c"ashfall")
        .api_version(vk::API_VERSION_1_3);
    let mut info = vk::InstanceCreateInfo::default().application_info(&application);
    let layers = [VALIDATION.as_ptr()];
    let extensions = [
        ash::ext::debug_utils::NAME.as_ptr(),
        ash::ext::validation_features::NAME.as_ptr(),
    ];
    let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
    let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
    let mut messenger;
    if let Some(messages) = messages {
        // SAFETY: a query without preconditions.
        let present = check("vkEnumerateInstanceLayerProperties", unsafe {
            entry.enumerate_instance_layer_properties()
        })?;
        if !present
            .iter()
            .any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION))
        {
            return Err(Error::Unsupported {
                what: "validation: the layer VK_LAYER_KHRONOS_validation is not installed (Debian: \
                       vulkan-validationlayers)"
                    .into(),
            });
        }
        messenger = messages.create_info();
        info = info
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions)
            .push_next(&mut features)
            .push_next(&mut messenger);
    }
    // SAFETY: every pointer in `info` outlives the call; `messages` outlives the instance.
    check("vkCreateInstance", unsafe { entry.create_instance(&info, None) })
}

fn enumerate(instance: &ash::Instance) -> Result<Vec<vk::PhysicalDevice>> {
    // SAFETY: the instance is alive.
    check("vkEnumeratePhysicalDevices", unsafe {
        instance.enumerate_physical_devices()
    })
}

/// Index of the device that `wanted` gives by index or part of its name; by default the first discrete GPU, else the
/// first integrated, other or CPU device. The error lists the devices.
fn choose(caps: &[Caps], wanted: Option<&str>) -> Result<usize> {
    let names = || {
        caps.iter()
            .enumerate()
            .map(|(i, c)| format!("{i}: {}", c.name))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let found = match wanted {
        None => (0..caps.len()).min_by_key(|&i| match caps[i].kind {
            DeviceKind::Discrete => 0,
            DeviceKind::Integrated => 1,
            DeviceKind::Other => 2,
            DeviceKind::Cpu => 3,
        }),
        Some(text) => text.parse().ok().filter(|&i: &usize| i < caps.len()).or_else(|| {
            caps.iter()
                .position(|c| c.name.to_lowercase().contains(&text.to_lowercase()))
        }),
    };
    found.ok_or_else(|| Error::Unsupported {
        what: match wanted {
            Some(text) => format!("device \"{text}\": there is only {}", names()),
            None => "no Vulkan device found (Debian: mesa-vulkan-drivers has a software one)".into(),
        },
    })
}

fn compute_family(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Option<u32> {
    // SAFETY: `physical` belongs to `instance`.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let with = |flags| families.iter().position(|f| f.queue_flags.contains(flags));
    with(vk::QueueFlags::COMPUTE).map(|index| index as u32)
}

fn create_device(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    caps: &mut Caps,
    family: u32,
) -> Result<ash::Device> {
    let mut has12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut has13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut has = vk::PhysicalDeviceFeatures2::default();
    if caps.api >= (REQUIRED.api.0, REQUIRED.api.1, 0) {
        has = has.push_next(&mut has12).push_next(&mut has13);
    }
    // SAFETY: `physical` belongs to `instance`, and the chain holds structures of its version.
    unsafe { instance.get_physical_device_features2(physical, &mut has) };
    // SAFETY: the structures of the chain are alive.
    let offered = unsafe { HostFeatures::of_chain(&has) };
    let mut unmet = REQUIRED.unmet(caps);
    unmet.extend(missing_texts(&offered));
    refuse_unmet(&caps.name, &unmet)?;
    let size_control = offered.subgroup_size_control;
    if !size_control {
        caps.without_size_control();
    }
    let mut want12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut want13 = vk::PhysicalDeviceVulkan13Features::default().subgroup_size_control(size_control);
    let mut want = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut want12)
        .push_next(&mut want13);
    // SAFETY: the structures of the chain are alive, and have every required feature.
    unsafe { REQUIRED.enable(&mut want) };
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(family)
        .queue_priorities(&priorities)];
    let mut want_floats =
        vk::PhysicalDeviceShaderAtomicFloatFeaturesEXT::default().shader_buffer_float32_atomic_add(true);
    let extensions = [ash::ext::shader_atomic_float::NAME.as_ptr()];
    let mut info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .push_next(&mut want);
    if caps.offers.contains(&Requirement::AtomicFloatAdd) {
        info = info.enabled_extension_names(&extensions).push_next(&mut want_floats);
    }
    // SAFETY: every pointer in `info` outlives the call, and only offered features are enabled.
    check("vkCreateDevice", unsafe {
        instance.create_device(physical, &info, None)
    })
}

impl Gpu {
    /// Creates a device.
    ///
    /// # Errors
    /// [`Error::Unsupported`] without a loader, a device that meets [`REQUIRED`], or a requested validation layer.
    pub fn create(options: &GpuOptions) -> Result<Gpu> {
        let entry = load()?;
        let messages = Arc::new(Messages::default());
        if let Some(faults) = &options.faults {
            faults.watch(&messages);
        }
        let instance = create_instance(&entry, options.validation.then_some(&*messages))?;
        // Dropping `own` cleans up after errors from here on.
        let mut own = Own {
            instance,
            messages,
            messenger: None,
            entry,
        };
        if options.validation {
            let utils = ash::ext::debug_utils::Instance::new(&own.entry, &own.instance);
            let info = own.messages.create_info();
            // SAFETY: `own` keeps the messages as long as the messenger.
            let handle = unsafe { utils.create_debug_utils_messenger(&info, None) };
            own.messenger = Some((utils, check("vkCreateDebugUtilsMessengerEXT", handle)?));
        }
        let instance = own.instance.clone();
        let physical = enumerate(&instance)?;
        let caps: Vec<Caps> = physical.iter().map(|&device| Caps::query(&instance, device)).collect();
        let index = choose(&caps, options.device.as_deref())?;
        let (physical, mut caps) = (physical[index], caps[index].clone());
        caps.lower(&options.limits);
        let family = compute_family(&instance, physical).ok_or_else(|| Error::Unsupported {
            what: format!("{} has no compute queue", caps.name),
        })?;
        let device = create_device(&instance, physical, &mut caps, family)?;
        // SAFETY: the family's first queue was requested above.
        let queue = unsafe { device.get_device_queue(family, 0) };
        let parts = Parts {
            instance,
            physical,
            device,
            caps,
            family,
            queue: Some(queue),
            allocator: None,
            pipeline_cache: vk::PipelineCache::null(),
            has_memory_budget: false,
            has_debug_utils: options.validation,
            own: Some(own),
        };
        parts.into_gpu(options)
    }
}
