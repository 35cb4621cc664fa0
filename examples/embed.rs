//! Embedding: the engine draws into a host's image, on the host's Vulkan device and in its command buffer.
//!
//!     cargo run --release --example embed
//!
//! Left out: a window, several frames in flight, and destruction of the host's objects.

use ash::vk;
use ashfall::gpu::{HostFeatures, HostImageDesc, HostQueue, ImageState};
use ashfall::{
    Camera, Gpu, HostCommands, HostDevice, HostImage, Model, REQUIRED, RenderOptions, Renderer, ScreenFilter, Splats,
    ViewOptions,
};
use glam::{DMat3, DVec2, DVec3};
use std::error::Error;

const SIZE: [u32; 2] = [320, 240];
const FORMAT: vk::Format = vk::Format::R8G8B8A8_UNORM;

fn main() -> Result<(), Box<dyn Error>> {
    let host = Host::new()?;
    let gpu = host.introduce()?;
    let model = Model::upload(&gpu, &ball())?;
    let mut renderer = Renderer::new(&gpu, RenderOptions::default())?;
    renderer.reserve(&model, &camera(), 1 << 16)?;

    let (image, view) = host.create_image()?;
    let commands = host.command_buffer()?;
    let device = &host.device;
    // SAFETY: the command buffer is not in use.
    unsafe { device.begin_command_buffer(commands, &vk::CommandBufferBeginInfo::default()) }?;
    {
        let before = ImageState {
            layout: vk::ImageLayout::UNDEFINED,
            stage: vk::PipelineStageFlags2::NONE,
            access: vk::AccessFlags2::NONE,
        };
        let after = ImageState {
            layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
            stage: vk::PipelineStageFlags2::COPY,
            access: vk::AccessFlags2::TRANSFER_READ,
        };
        let desc = HostImageDesc {
            image,
            view,
            format: FORMAT,
            extent: SIZE,
            before,
            after,
        };
        // SAFETY: the command buffer is recording, and the image has storage usage.
        let (mut commands, target) = unsafe { (HostCommands::wrap(commands), HostImage::wrap(desc)) };
        let options = ViewOptions {
            background: [0.1; 3],
            near: 0.01,
            filter: ScreenFilter::Classic,
        };
        renderer.record(&mut commands, &model, &camera(), &options, &target)?;
    }
    let submitted = [commands];
    let submit = vk::SubmitInfo::default().command_buffers(&submitted);
    // SAFETY: everything recorded is alive until the queue is idle.
    unsafe {
        device.end_command_buffer(commands)?;
        device.queue_submit(host.queue, &[submit], vk::Fence::null())?;
        device.queue_wait_idle(host.queue)?;
    }
    println!("drew {} splats into the host's image", model.splat_count);
    Ok(())
}

/// Vulkan objects of the host.
struct Host {
    _entry: ash::Entry,
    instance: ash::Instance,
    physical_device: vk::PhysicalDevice,
    device: ash::Device,
    enabled: HostFeatures,
    queue: vk::Queue,
}

impl Host {
    fn new() -> Result<Host, Box<dyn Error>> {
        // SAFETY: the system's Vulkan loader.
        let entry = unsafe { ash::Entry::load() }?;
        let (major, minor) = REQUIRED.api;
        let application = vk::ApplicationInfo::default().api_version(vk::make_api_version(0, major, minor, 0));
        let info = vk::InstanceCreateInfo::default().application_info(&application);
        // SAFETY: `info` outlives the call.
        let instance = unsafe { entry.create_instance(&info, None) }?;
        // SAFETY: the instance is alive.
        let physical_device = unsafe { instance.enumerate_physical_devices() }?[0];
        let (device, enabled) = create_device(&instance, physical_device)?;
        // SAFETY: the device has one queue of family 0.
        let queue = unsafe { device.get_device_queue(0, 0) };
        Ok(Host {
            _entry: entry,
            instance,
            physical_device,
            device,
            enabled,
            queue,
        })
    }

    /// The engine as a guest on the host's device.
    fn introduce(&self) -> ashfall::Result<Gpu> {
        let host = HostDevice {
            instance: self.instance.clone(),
            physical_device: self.physical_device,
            device: self.device.clone(),
            queue_family: 0,
            queue: Some(HostQueue { queue: self.queue }),
            api_version: vk::make_api_version(0, REQUIRED.api.0, REQUIRED.api.1, 0),
            enabled: self.enabled,
            allocator: None,
            memory_limit: None,
            pipeline_cache: vk::PipelineCache::null(),
        };
        // SAFETY: the handles belong together and outlive the guest; REQUIRED is enabled.
        unsafe { Gpu::adopt(host) }
    }

    fn command_buffer(&self) -> Result<vk::CommandBuffer, Box<dyn Error>> {
        let pool = vk::CommandPoolCreateInfo::default();
        // SAFETY: plain objects of the host's device.
        let pool = unsafe { self.device.create_command_pool(&pool, None) }?;
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .command_buffer_count(1);
        // SAFETY: the pool is new.
        Ok(unsafe { self.device.allocate_command_buffers(&info) }?[0])
    }

    fn create_image(&self) -> Result<(vk::Image, vk::ImageView), Box<dyn Error>> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(FORMAT)
            .extent(vk::Extent3D {
                width: SIZE[0],
                height: SIZE[1],
                depth: 1,
            })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC);
        let range = vk::ImageSubresourceRange::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .level_count(1)
            .layer_count(1);
        // SAFETY: plain objects of the host's device; the memory is bound once and fits.
        unsafe {
            let device = &self.device;
            let image = device.create_image(&info, None)?;
            let needs = device.get_image_memory_requirements(image);
            let types = self
                .instance
                .get_physical_device_memory_properties(self.physical_device);
            let kind = (0..types.memory_type_count).find(|kind| needs.memory_type_bits >> kind & 1 == 1);
            let allocation = vk::MemoryAllocateInfo::default()
                .allocation_size(needs.size)
                .memory_type_index(kind.ok_or("no memory for an image")?);
            device.bind_image_memory(image, device.allocate_memory(&allocation, None)?, 0)?;
            let view = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(FORMAT)
                .subresource_range(range);
            Ok((image, device.create_image_view(&view, None)?))
        }
    }
}

/// Device with everything in REQUIRED.
fn create_device(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
) -> Result<(ash::Device, HostFeatures), Box<dyn Error>> {
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut chain = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: the structures of the chain are alive.
    let (missing, enabled) = unsafe { (REQUIRED.enable(&mut chain), HostFeatures::of_chain(&chain)) };
    assert!(missing.is_empty(), "the chain has both structures");
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(0)
        .queue_priorities(&[1.0])];
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .push_next(&mut chain);
    // SAFETY: `info` outlives the call.
    let device = unsafe { instance.create_device(physical, &info, None) }?;
    Ok((device, enabled))
}

/// One orange splat at the origin.
fn ball() -> Splats {
    Splats {
        mean: vec![[0.0; 3]],
        quaternion: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scale: vec![[-1.5; 3]],
        opacity_logit: vec![4.0],
        sh: vec![1.5, 0.2, -1.0],
        sh_degree: 0,
        ..Splats::default()
    }
}

fn camera() -> Camera {
    Camera {
        width: SIZE[0],
        height: SIZE[1],
        focal: DVec2::splat(f64::from(SIZE[1])),
        center: DVec2::new(f64::from(SIZE[0]), f64::from(SIZE[1])) / 2.0,
        rotation: DMat3::IDENTITY,
        position: DVec3::new(0.0, 0.0, -3.0),
    }
}
