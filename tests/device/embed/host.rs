//! Host application: it owns the device and lends it to the engine.
//!
//! It enables exactly `ashfall::gpu::REQUIRED`, unless told otherwise, and destroys its own objects at the end, when
//! the validation layer reports every object that the engine leaked.

use crate::common::device::{Turn, turn};
use crate::embed::watch;
use ash::vk;
use ashfall::gpu::MissingStruct;
use ashfall::gpu::{HostDevice, HostFeatures, HostQueue, REQUIRED};
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};
use std::ffi::{CStr, c_void};
use std::rc::Rc;
use std::sync::{Arc, Mutex};

type Messages = Mutex<Vec<String>>;

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

pub(crate) struct Host {
    messages: Box<Messages>,
    messenger: vk::DebugUtilsMessengerEXT,
    debug: ash::ext::debug_utils::Instance,
    pub(crate) instance: ash::Instance,
    pub(crate) physical: vk::PhysicalDevice,
    pub(crate) device: ash::Device,
    pub(crate) queue: vk::Queue,
    pub(crate) allocator: Option<Arc<Mutex<Allocator>>>,
    pub(crate) entry: ash::Entry,
    pub(crate) enabled: HostFeatures,
    pub(crate) api_version: u32,
    _turn: Rc<Turn>,
}

/// The device's creation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Creation {
    /// Exactly the required features, in the structures of Vulkan 1.2 and 1.3.
    Required,
    /// The features that wgpu 30 enables by default, in its structures (`maintenance4` off), and the missing ones in
    /// structures of their own; VK_EXT_debug_utils.
    Wgpu,
    /// The features of Vulkan 1.2, on an instance of that version.
    Version12,
}

impl Host {
    /// A device with exactly the required features.
    pub(crate) fn new() -> Host {
        Host::of(Creation::Required)
    }

    pub(crate) fn of(creation: Creation) -> Host {
        let turn = turn();
        let messages = Box::<Messages>::default();
        let (major, minor) = if creation == Creation::Version12 {
            (1, 2)
        } else {
            REQUIRED.api
        };
        let api_version = vk::make_api_version(0, major, minor, 0);
        // SAFETY: the system's Vulkan loader.
        let entry = unsafe { ash::Entry::load() }.unwrap();
        let instance = instance(&entry, &messages, api_version);
        let debug = ash::ext::debug_utils::Instance::new(&entry, &instance);
        // SAFETY: the messages live in the host, which destroys the messenger.
        let messenger = unsafe { debug.create_debug_utils_messenger(&messenger(&messages), None) }.unwrap();
        // SAFETY: the instance is alive.
        let physical = unsafe { instance.enumerate_physical_devices() }.unwrap()[0];
        let (device, enabled) = match creation {
            Creation::Required => required(&instance, physical),
            Creation::Wgpu => like_wgpu(&instance, physical),
            Creation::Version12 => version_12(&instance, physical),
        };
        let device = watch::watched(&instance, &device);
        // SAFETY: the queue was requested at device creation.
        let queue = unsafe { device.get_device_queue(0, 0) };
        let desc = AllocatorCreateDesc {
            instance: instance.clone(),
            device: device.clone(),
            physical_device: physical,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        };
        Host {
            messages,
            messenger,
            debug,
            physical,
            queue,
            allocator: Some(Arc::new(Mutex::new(Allocator::new(&desc).unwrap()))),
            instance,
            device,
            entry,
            enabled,
            api_version,
            _turn: turn,
        }
    }

    /// The description passed to `Gpu::adopt`.
    pub(crate) fn introduce(&self, with_queue: bool, with_allocator: bool) -> HostDevice {
        HostDevice {
            instance: self.instance.clone(),
            physical_device: self.physical,
            device: self.device.clone(),
            queue_family: 0,
            queue: with_queue.then_some(HostQueue { queue: self.queue }),
            api_version: self.api_version,
            enabled: self.enabled,
            allocator: self.allocator.clone().filter(|_| with_allocator),
            memory_limit: None,
            pipeline_cache: vk::PipelineCache::null(),
        }
    }

    /// Messages of the validation layer since the last call.
    pub(crate) fn messages(&self) -> Vec<String> {
        std::mem::take(&mut self.messages.lock().unwrap())
    }

    pub(crate) fn allocator(&self) -> &Mutex<Allocator> {
        self.allocator.as_ref().unwrap()
    }

    pub(crate) fn allocate(
        &self,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Allocation {
        let desc = AllocationCreateDesc {
            name: "host",
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        self.allocator().lock().unwrap().allocate(&desc).unwrap()
    }

    pub(crate) fn free(&self, allocation: Allocation) {
        self.allocator().lock().unwrap().free(allocation).unwrap();
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        let allocator = self.allocator.take().unwrap();
        assert_eq!(Arc::strong_count(&allocator), 1, "someone keeps the host's allocator");
        let report = allocator.lock().unwrap().generate_report();
        assert_eq!(report.total_allocated_bytes, 0, "memory was left behind");
        drop(allocator);
        // SAFETY: the host's own, idle and not used again. Leaked objects of the engine are reported here.
        unsafe { self.device.destroy_device(None) };
        let messages = self.messages();
        // SAFETY: as above.
        unsafe { self.debug.destroy_debug_utils_messenger(self.messenger, None) };
        // SAFETY: the device, destroyed above, was the last object made from it.
        unsafe { self.instance.destroy_instance(None) };
        assert_eq!(messages, Vec::<String>::new(), "validation messages");
    }
}

fn messenger(messages: &Messages) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
    use vk::DebugUtilsMessageSeverityFlagsEXT as Severity;
    vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(Severity::WARNING | Severity::ERROR)
        .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
        .pfn_user_callback(Some(on_message))
        .user_data(std::ptr::from_ref(messages).cast_mut().cast())
}

unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan's data is valid; `user` is the pointer passed in `messenger`.
    let (data, messages) = unsafe { (&*data, &*user.cast::<Messages>()) };
    // SAFETY: a C string of the layer's, or null.
    let text = unsafe { data.message_as_c_str() };
    let text = text.map(|text| text.to_string_lossy().into_owned());
    messages.lock().unwrap().extend(text);
    vk::FALSE
}

fn instance(entry: &ash::Entry, messages: &Messages, api_version: u32) -> ash::Instance {
    let application = vk::ApplicationInfo::default()
        .application_name(c"host")
        .api_version(api_version);
    let layers = [VALIDATION.as_ptr()];
    let extensions = [
        ash::ext::debug_utils::NAME.as_ptr(),
        ash::ext::validation_features::NAME.as_ptr(),
    ];
    let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
    let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
    let mut messenger = messenger(messages);
    let info = vk::InstanceCreateInfo::default()
        .application_info(&application)
        .enabled_layer_names(&layers)
        .enabled_extension_names(&extensions)
        .push_next(&mut features)
        .push_next(&mut messenger);
    // SAFETY: the pointees of `info` outlive the call; the messages outlive the instance.
    unsafe { entry.create_instance(&info, None) }.unwrap()
}

/// A device with these features.
fn create(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    chain: &mut vk::PhysicalDeviceFeatures2<'_>,
) -> ash::Device {
    assert!(REQUIRED.extensions.is_empty(), "this host enables no extension");
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(0)
        .queue_priorities(&[1.0])];
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .push_next(chain);
    // SAFETY: the pointees of `info` outlive the call.
    unsafe { instance.create_device(physical, &info, None) }.unwrap()
}

fn required(instance: &ash::Instance, physical: vk::PhysicalDevice) -> (ash::Device, HostFeatures) {
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut chain = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: the structures are alive.
    let missing = unsafe { REQUIRED.enable(&mut chain) };
    assert_eq!(missing, []);
    // SAFETY: as above.
    let enabled = unsafe { HostFeatures::of_chain(&chain) };
    (create(instance, physical, &mut chain), enabled)
}

fn like_wgpu(instance: &ash::Instance, physical: vk::PhysicalDevice) -> (ash::Device, HostFeatures) {
    let mut timeline = vk::PhysicalDeviceTimelineSemaphoreFeatures::default().timeline_semaphore(true);
    let mut sizes = vk::PhysicalDeviceSubgroupSizeControlFeatures::default().subgroup_size_control(true);
    let mut robust = vk::PhysicalDeviceImageRobustnessFeatures::default().robust_image_access(true);
    let mut maintenance = vk::PhysicalDeviceMaintenance4Features::default();
    let (mut scalar, mut synchronization) = Default::default();
    let core = vk::PhysicalDeviceFeatures::default()
        .robust_buffer_access(true)
        .independent_blend(true)
        .sample_rate_shading(true)
        .image_cube_array(true)
        .fragment_stores_and_atomics(true);
    let mut chain = vk::PhysicalDeviceFeatures2::default()
        .features(core)
        .push_next(&mut timeline)
        .push_next(&mut sizes)
        .push_next(&mut robust)
        .push_next(&mut maintenance);
    // SAFETY: the structures are alive.
    let missing = unsafe { REQUIRED.enable(&mut chain) };
    assert_lacks_two(&missing);
    chain = chain
        .push_next::<vk::PhysicalDeviceScalarBlockLayoutFeatures<'_>>(&mut scalar)
        .push_next::<vk::PhysicalDeviceSynchronization2Features<'_>>(&mut synchronization);
    // SAFETY: as above.
    let (missing, enabled) = unsafe { (REQUIRED.enable(&mut chain), HostFeatures::of_chain(&chain)) };
    assert_eq!(missing, []);
    assert!(enabled.subgroup_size_control);
    let enabled = HostFeatures {
        debug_utils: true,
        ..enabled
    };
    (create(instance, physical, &mut chain), enabled)
}

fn version_12(instance: &ash::Instance, physical: vk::PhysicalDevice) -> (ash::Device, HostFeatures) {
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut chain = vk::PhysicalDeviceFeatures2::default().push_next(&mut v12);
    // SAFETY: the structures are alive.
    let (missing, enabled) = unsafe { (REQUIRED.enable(&mut chain), HostFeatures::of_chain(&chain)) };
    let names: Vec<&str> = missing.iter().map(|missing| missing.feature).collect();
    assert_eq!(names, ["synchronization2"]);
    (create(instance, physical, &mut chain), enabled)
}

/// Asserts that a chain as wgpu makes it lacks two structures of `REQUIRED`, and which.
#[track_caller]
pub(crate) fn assert_lacks_two(missing: &[MissingStruct]) {
    let types: Vec<_> = missing.iter().map(|missing| missing.structure).collect();
    let scalar_type = vk::StructureType::PHYSICAL_DEVICE_SCALAR_BLOCK_LAYOUT_FEATURES;
    let synchronization_type = vk::StructureType::PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES;
    assert_eq!(types, [scalar_type, synchronization_type]);
}
