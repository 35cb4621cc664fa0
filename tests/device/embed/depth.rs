//! Depth image of a host, filled from numbers.

use crate::embed::frame::UPLOADED;
use crate::embed::host::Host;
use ash::vk;
use ashfall::gpu::{HostImage, HostImageDesc, ImageState};
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

/// State for the host's next depth test.
pub(crate) const TESTED: ImageState = ImageState {
    layout: vk::ImageLayout::GENERAL,
    stage: vk::PipelineStageFlags2::EARLY_FRAGMENT_TESTS,
    access: vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_READ,
};

pub(crate) struct DepthImage<'a> {
    host: &'a Host,
    pub(crate) format: vk::Format,
    extent: [u32; 2],
    image: vk::Image,
    view: vk::ImageView,
    buffer: vk::Buffer,
    memory: Vec<Allocation>,
}

/// Aspects of the image, and the one that is read.
fn aspects(format: vk::Format) -> (vk::ImageAspectFlags, vk::ImageAspectFlags) {
    use vk::ImageAspectFlags as Aspect;
    match format {
        vk::Format::R32_SFLOAT => (Aspect::COLOR, Aspect::COLOR),
        vk::Format::D24_UNORM_S8_UINT => (Aspect::DEPTH | Aspect::STENCIL, Aspect::DEPTH),
        _ => (Aspect::DEPTH, Aspect::DEPTH),
    }
}

fn range(aspects: vk::ImageAspectFlags) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(aspects)
        .level_count(1)
        .layer_count(1)
}

impl<'a> DepthImage<'a> {
    /// An image with these values, rounded to the format; each value as stored.
    pub(crate) fn new(
        host: &'a Host,
        format: vk::Format,
        extent: [u32; 2],
        values: &[f64],
    ) -> (DepthImage<'a>, Vec<f64>) {
        let device = &host.device;
        use vk::ImageUsageFlags as Usage;
        let [width, height] = extent;
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D {
                width,
                height,
                depth: 1,
            })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(Usage::SAMPLED | Usage::TRANSFER_DST);
        // SAFETY: a plain image.
        let image = unsafe { device.create_image(&info, None) }.unwrap();
        // SAFETY: just made.
        let requirements = unsafe { device.get_image_memory_requirements(image) };
        let of_image = host.allocate(requirements, MemoryLocation::GpuOnly, false);
        // SAFETY: memory as required, bound once.
        unsafe { device.bind_image_memory(image, of_image.memory(), of_image.offset()) }.unwrap();
        let info = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(range(aspects(format).1));
        // SAFETY: the image has its memory.
        let view = unsafe { device.create_image_view(&info, None) }.unwrap();
        let (bytes, stored) = encode(format, values);
        let info = vk::BufferCreateInfo::default()
            .size(bytes.len() as u64)
            .usage(vk::BufferUsageFlags::TRANSFER_SRC);
        // SAFETY: a plain buffer.
        let buffer = unsafe { device.create_buffer(&info, None) }.unwrap();
        // SAFETY: just made.
        let requirements = unsafe { device.get_buffer_memory_requirements(buffer) };
        let mut of_buffer = host.allocate(requirements, MemoryLocation::CpuToGpu, true);
        // SAFETY: memory as required, bound once.
        unsafe { device.bind_buffer_memory(buffer, of_buffer.memory(), of_buffer.offset()) }.unwrap();
        of_buffer.mapped_slice_mut().unwrap()[..bytes.len()].copy_from_slice(&bytes);
        let image = DepthImage {
            host,
            format,
            extent,
            image,
            view,
            buffer,
            memory: vec![of_image, of_buffer],
        };
        (image, stored)
    }

    /// Records the upload, which leaves the image [`UPLOADED`].
    pub(crate) fn upload(&self, commands: vk::CommandBuffer) {
        let device = &self.host.device;
        let (all, read) = aspects(self.format);
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_stage_mask(UPLOADED.stage)
            .dst_access_mask(UPLOADED.access)
            .new_layout(UPLOADED.layout)
            .image(self.image)
            .subresource_range(range(all))];
        let dependency = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        let [width, height] = self.extent;
        let regions = [vk::BufferImageCopy::default()
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: read,
                layer_count: 1,
                ..Default::default()
            })
            .image_extent(vk::Extent3D {
                width,
                height,
                depth: 1,
            })];
        // SAFETY: the host's own objects; the commands are being recorded.
        unsafe {
            device.cmd_pipeline_barrier2(commands, &dependency);
            device.cmd_copy_buffer_to_image(commands, self.buffer, self.image, UPLOADED.layout, &regions);
        }
    }

    /// The image as the engine's, in the state after its upload.
    pub(crate) fn source(&self) -> HostImage {
        let desc = HostImageDesc {
            image: self.image,
            view: self.view,
            format: self.format,
            extent: self.extent,
            before: UPLOADED,
            after: TESTED,
        };
        // SAFETY: image and view live until the frame has been waited for.
        unsafe { HostImage::wrap(desc) }
    }
}

/// Bytes of values for a copy to an image, and the values as stored.
fn encode(format: vk::Format, values: &[f64]) -> (Vec<u8>, Vec<f64>) {
    let unorm = |value: f64, most: f64| (value.clamp(0.0, 1.0) * most).round();
    let (mut bytes, mut stored) = (Vec::new(), Vec::new());
    for &value in values {
        match format {
            vk::Format::D16_UNORM => {
                let word = unorm(value, 65_535.0);
                bytes.extend((word as u16).to_le_bytes());
                stored.push(word / 65_535.0);
            }
            vk::Format::D24_UNORM_S8_UINT => {
                let word = unorm(value, 16_777_215.0);
                bytes.extend((word as u32).to_le_bytes());
                stored.push(word / 16_777_215.0);
            }
            _ => {
                bytes.extend((value as f32).to_le_bytes());
                stored.push(f64::from(value as f32));
            }
        }
    }
    (bytes, stored)
}

impl Drop for DepthImage<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        let device = &self.host.device;
        // SAFETY: the frames that read it have been waited for.
        unsafe {
            device.destroy_image_view(self.view, None);
            device.destroy_image(self.image, None);
            device.destroy_buffer(self.buffer, None);
        }
        self.memory.drain(..).for_each(|memory| self.host.free(memory));
    }
}
