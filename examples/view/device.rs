//! The host's Vulkan device and surface, images and buffers.

use ash::vk;
use ash_window::{create_surface, enumerate_required_extensions};
use ashfall::gpu::{HostFeatures, HostQueue};
use ashfall::{Gpu, HostDevice, REQUIRED};
use std::error::Error;
use std::ffi::{CStr, c_void};
use std::sync::atomic::{AtomicUsize, Ordering};
use winit::raw_window_handle::{HasDisplayHandle, HasWindowHandle};
use winit::window::Window;

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Messages of the validation layer.
pub(crate) static MESSAGES: AtomicUsize = AtomicUsize::new(0);

pub(crate) struct Device {
    entry: ash::Entry,
    pub(crate) instance: ash::Instance,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub(crate) physical: vk::PhysicalDevice,
    pub(crate) handle: ash::Device,
    enabled: HostFeatures,
    pub(crate) family: u32,
    pub(crate) queue: vk::Queue,
    pub(crate) surfaces: ash::khr::surface::Instance,
    pub(crate) swapchains: ash::khr::swapchain::Device,
    pub(crate) surface: vk::SurfaceKHR,
}

/// An image of one mip level and layer.
pub(crate) struct Picture {
    pub(crate) image: vk::Image,
    pub(crate) view: vk::ImageView,
    memory: vk::DeviceMemory,
    pub(crate) extent: [u32; 2],
}

/// A mapped buffer.
pub(crate) struct Pinned {
    pub(crate) buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    bytes: *mut u8,
    len: usize,
}

pub(crate) const RANGE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

impl Device {
    pub(crate) fn new(window: &Window, validate: bool) -> Result<Device, Box<dyn Error>> {
        // SAFETY: the system's Vulkan loader.
        let entry = unsafe { ash::Entry::load() }?;
        let mut extensions = enumerate_required_extensions(window.display_handle()?.as_raw())?.to_vec();
        let layers: Vec<_> = validate.then_some(VALIDATION.as_ptr()).into_iter().collect();
        if validate {
            extensions.extend([ash::ext::debug_utils::NAME, ash::ext::validation_features::NAME].map(CStr::as_ptr));
        }
        let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
        let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut checks = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        if validate {
            info = info.push_next(&mut checks);
        }
        // SAFETY: `info` outlives the call.
        let instance = unsafe { entry.create_instance(&info, None) }?;
        let messenger = match validate {
            true => Some(listen(&entry, &instance)?),
            false => None,
        };
        let surface = surface(&entry, &instance, window)?;
        let surfaces = ash::khr::surface::Instance::new(&entry, &instance);
        let (physical, family) = choose(&instance, &surfaces, surface)?;
        let (handle, enabled) = create(&instance, physical, family)?;
        // SAFETY: the device has one queue of this family.
        let queue = unsafe { handle.get_device_queue(family, 0) };
        Ok(Device {
            swapchains: ash::khr::swapchain::Device::new(&instance, &handle),
            entry,
            messenger,
            physical,
            handle,
            enabled,
            family,
            queue,
            surfaces,
            surface,
            instance,
        })
    }

    /// The engine as a guest, which is dropped before the device.
    pub(crate) fn adopt(&self) -> ashfall::Result<Gpu> {
        let host = HostDevice {
            instance: self.instance.clone(),
            physical_device: self.physical,
            device: self.handle.clone(),
            queue_family: self.family,
            queue: Some(HostQueue { queue: self.queue }),
            api_version: vk::API_VERSION_1_3,
            enabled: self.enabled,
            allocator: None,
            memory_limit: None,
            pipeline_cache: vk::PipelineCache::null(),
        };
        // SAFETY: the handles belong together, and REQUIRED is enabled.
        unsafe { Gpu::adopt(host) }
    }

    /// Replaces a lost surface, whose swapchain has been destroyed.
    pub(crate) fn renew_surface(&mut self, window: &Window) -> Result<(), Box<dyn Error>> {
        // SAFETY: nothing uses the surface.
        unsafe { self.surfaces.destroy_surface(self.surface, None) };
        self.surface = vk::SurfaceKHR::null();
        self.surface = surface(&self.entry, &self.instance, window)?;
        Ok(())
    }

    pub(crate) fn wait(&self) {
        // SAFETY: the queue is used by this thread alone.
        let waited = unsafe { self.handle.device_wait_idle() };
        waited.unwrap_or_else(|error| eprintln!("error: {error}"));
    }

    fn allocate(
        &self,
        needs: vk::MemoryRequirements,
        wanted: vk::MemoryPropertyFlags,
    ) -> Result<vk::DeviceMemory, Box<dyn Error>> {
        // SAFETY: a query, and a plain allocation.
        let types = unsafe { self.instance.get_physical_device_memory_properties(self.physical) };
        let fits = |i: &u32| {
            let flags = types.memory_types[*i as usize].property_flags;
            needs.memory_type_bits >> i & 1 == 1 && flags.contains(wanted)
        };
        let kind = (0..types.memory_type_count)
            .find(fits)
            .ok_or("no memory of this kind")?;
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(kind);
        // SAFETY: as above.
        Ok(unsafe { self.handle.allocate_memory(&info, None) }?)
    }

    pub(crate) fn picture(
        &self,
        [width, height]: [u32; 2],
        usage: vk::ImageUsageFlags,
    ) -> Result<Picture, Box<dyn Error>> {
        let format = vk::Format::R8G8B8A8_UNORM;
        let extent = vk::Extent3D {
            width,
            height,
            depth: 1,
        };
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(extent)
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(usage);
        // SAFETY: plain objects; the memory is bound once and fits.
        unsafe {
            let image = self.handle.create_image(&info, None)?;
            let needs = self.handle.get_image_memory_requirements(image);
            let memory = self.allocate(needs, vk::MemoryPropertyFlags::empty())?;
            self.handle.bind_image_memory(image, memory, 0)?;
            let info = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(format)
                .subresource_range(RANGE);
            let view = self.handle.create_image_view(&info, None)?;
            let extent = [width, height];
            Ok(Picture {
                image,
                view,
                memory,
                extent,
            })
        }
    }

    pub(crate) fn pinned(&self, len: usize) -> Result<Pinned, Box<dyn Error>> {
        use vk::MemoryPropertyFlags as Memory;
        let info = vk::BufferCreateInfo::default()
            .size(len as u64)
            .usage(vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST);
        // SAFETY: plain objects; the memory is bound once, fits and is mapped whole.
        unsafe {
            let buffer = self.handle.create_buffer(&info, None)?;
            let needs = self.handle.get_buffer_memory_requirements(buffer);
            let memory = self.allocate(needs, Memory::HOST_VISIBLE | Memory::HOST_COHERENT)?;
            self.handle.bind_buffer_memory(buffer, memory, 0)?;
            let flags = vk::MemoryMapFlags::empty();
            let bytes = self.handle.map_memory(memory, 0, vk::WHOLE_SIZE, flags)?.cast();
            Ok(Pinned {
                buffer,
                memory,
                bytes,
                len,
            })
        }
    }

    /// Destroys pictures that no commands in flight use.
    pub(crate) fn destroy(&self, pictures: impl IntoIterator<Item = Picture>) {
        for picture in pictures {
            // SAFETY: not in use, as the caller says.
            unsafe {
                self.handle.destroy_image_view(picture.view, None);
                self.handle.destroy_image(picture.image, None);
                self.handle.free_memory(picture.memory, None);
            }
        }
    }

    /// Destroys a buffer that no commands in flight use.
    pub(crate) fn unpin(&self, pinned: Pinned) {
        // SAFETY: not in use, as the caller says.
        unsafe {
            self.handle.destroy_buffer(pinned.buffer, None);
            self.handle.free_memory(pinned.memory, None);
        }
    }
}

impl Pinned {
    pub(crate) fn bytes(&mut self) -> &mut [u8] {
        // SAFETY: mapped for as long as the buffer lives, and at least as long as it.
        unsafe { std::slice::from_raw_parts_mut(self.bytes, self.len) }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: everything made from the device is destroyed.
        unsafe {
            self.handle.destroy_device(None);
            self.surfaces.destroy_surface(self.surface, None);
            if let Some((debug, messenger)) = self.messenger.take() {
                debug.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

fn surface(entry: &ash::Entry, instance: &ash::Instance, window: &Window) -> Result<vk::SurfaceKHR, Box<dyn Error>> {
    let (display, handle) = (window.display_handle()?.as_raw(), window.window_handle()?.as_raw());
    // SAFETY: the window outlives its surface.
    Ok(unsafe { create_surface(entry, instance, display, handle, None) }?)
}

/// A device with a queue for graphics and compute that presents to the surface, a discrete one if there is one.
fn choose(
    instance: &ash::Instance,
    surfaces: &ash::khr::surface::Instance,
    surface: vk::SurfaceKHR,
) -> Result<(vk::PhysicalDevice, u32), Box<dyn Error>> {
    use vk::QueueFlags as Queue;
    let mut found = Vec::new();
    // SAFETY: queries.
    unsafe {
        for device in instance.enumerate_physical_devices()? {
            let families = instance.get_physical_device_queue_family_properties(device);
            for (family, properties) in (0..).zip(families) {
                if properties.queue_flags.contains(Queue::GRAPHICS | Queue::COMPUTE)
                    && surfaces.get_physical_device_surface_support(device, family, surface)?
                {
                    let kind = instance.get_physical_device_properties(device).device_type;
                    found.push((kind != vk::PhysicalDeviceType::DISCRETE_GPU, device, family));
                    break;
                }
            }
        }
    }
    let best = found.iter().min_by_key(|(is_other, ..)| *is_other);
    let best = best.map(|&(_, device, family)| (device, family));
    best.ok_or_else(|| "no Vulkan device draws to this window".into())
}

/// Device with everything in REQUIRED, and swapchains.
fn create(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    family: u32,
) -> Result<(ash::Device, HostFeatures), Box<dyn Error>> {
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut chain = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: the structures of the chain are alive.
    let enabled = unsafe {
        REQUIRED.enable(&mut chain);
        HostFeatures::of_chain(&chain)
    };
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(family)
        .queue_priorities(&[1.0])];
    let extensions = [ash::khr::swapchain::NAME.as_ptr()];
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .push_next(&mut chain);
    // SAFETY: `info` outlives the call.
    Ok((unsafe { instance.create_device(physical, &info, None) }?, enabled))
}

type Messenger = (ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT);

/// Prints and counts the validation layer's messages.
fn listen(entry: &ash::Entry, instance: &ash::Instance) -> Result<Messenger, vk::Result> {
    use vk::DebugUtilsMessageSeverityFlagsEXT as Severity;
    let debug = ash::ext::debug_utils::Instance::new(entry, instance);
    let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(Severity::WARNING | Severity::ERROR)
        .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
        .pfn_user_callback(Some(on_message));
    // SAFETY: the callback takes no data.
    let messenger = unsafe { debug.create_debug_utils_messenger(&info, None) }?;
    Ok((debug, messenger))
}

unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    _user: *mut c_void,
) -> vk::Bool32 {
    MESSAGES.fetch_add(1, Ordering::Relaxed);
    // SAFETY: Vulkan's data is valid, the text a C string or null.
    if let Some(text) = unsafe { (*data).message_as_c_str() } {
        eprintln!("validation: {}", text.to_string_lossy());
    }
    vk::FALSE
}
