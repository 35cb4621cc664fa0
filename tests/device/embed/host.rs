//! Host application: it owns the device and lends it to the engine.
//!
//! It enables exactly `ashfall::gpu::REQUIRED`, and destroys its own objects at the end, when the validation layer
//! reports every object that the engine leaked.

use crate::common::device::{Turn, turn};
use crate::embed::watch;
use ash::vk;
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
    storage_image_write_without_format: bool,
    _entry: ash::Entry,
    _turn: Rc<Turn>,
}

impl Host {
    /// A device with the required features, and optionally the one for presenting.
    pub(crate) fn new(storage_image_write_without_format: bool) -> Host {
        let turn = turn();
        let messages = Box::<Messages>::default();
        // SAFETY: the system's Vulkan loader.
        let entry = unsafe { ash::Entry::load() }.unwrap();
        let instance = instance(&entry, &messages);
        let debug = ash::ext::debug_utils::Instance::new(&entry, &instance);
        // SAFETY: the messages live in the host, which destroys the messenger.
        let messenger = unsafe { debug.create_debug_utils_messenger(&messenger(&messages), None) }.unwrap();
        // SAFETY: the instance is alive.
        let physical = unsafe { instance.enumerate_physical_devices() }.unwrap()[0];
        let device = device(&instance, physical, storage_image_write_without_format);
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
            storage_image_write_without_format,
            _entry: entry,
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
            enabled: HostFeatures {
                storage_image_write_without_format: self.storage_image_write_without_format,
                subgroup_size_control: false,
            },
            allocator: self.allocator.clone().filter(|_| with_allocator),
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

fn instance(entry: &ash::Entry, messages: &Messages) -> ash::Instance {
    let (major, minor) = REQUIRED.api;
    let application = vk::ApplicationInfo::default()
        .application_name(c"host")
        .api_version(vk::make_api_version(0, major, minor, 0));
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

fn device(instance: &ash::Instance, physical: vk::PhysicalDevice, writes: bool) -> ash::Device {
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    for &feature in REQUIRED.features {
        match feature {
            "scalarBlockLayout" => v12.scalar_block_layout = vk::TRUE,
            "timelineSemaphore" => v12.timeline_semaphore = vk::TRUE,
            "synchronization2" => v13.synchronization2 = vk::TRUE,
            "maintenance4" => v13.maintenance4 = vk::TRUE,
            other => panic!("REQUIRED lists {other}, which this host does not know"),
        }
    }
    assert!(REQUIRED.extensions.is_empty(), "this host enables no extension");
    let base = vk::PhysicalDeviceFeatures::default().shader_storage_image_write_without_format(writes);
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(0)
        .queue_priorities(&[1.0])];
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_features(&base)
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: the pointees of `info` outlive the call.
    unsafe { instance.create_device(physical, &info, None) }.unwrap()
}
