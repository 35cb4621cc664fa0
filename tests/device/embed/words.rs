//! Image of a host with a word a pixel, into which the engine copies.

use crate::embed::frame::COPYABLE;
use crate::embed::host::Host;
use ash::vk;
use ashfall::gpu::{HostImage, HostImageDesc, ImageState};
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

/// State of a new image, before the engine's copy.
const FRESH: ImageState = ImageState {
    layout: vk::ImageLayout::UNDEFINED,
    stage: vk::PipelineStageFlags2::NONE,
    access: vk::AccessFlags2::NONE,
};

pub(crate) struct WordImage<'a> {
    host: &'a Host,
    format: vk::Format,
    extent: [u32; 2],
    image: vk::Image,
    view: vk::ImageView,
    buffer: vk::Buffer,
    memory: Vec<Allocation>,
}

fn aspect(format: vk::Format) -> vk::ImageAspectFlags {
    match format {
        vk::Format::D32_SFLOAT | vk::Format::D16_UNORM => vk::ImageAspectFlags::DEPTH,
        _ => vk::ImageAspectFlags::COLOR,
    }
}

impl<'a> WordImage<'a> {
    pub(crate) fn new(host: &'a Host, format: vk::Format, extent: [u32; 2]) -> WordImage<'a> {
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
            .usage(Usage::SAMPLED | Usage::TRANSFER_SRC | Usage::TRANSFER_DST);
        // SAFETY: a plain image.
        let image = unsafe { device.create_image(&info, None) }.unwrap();
        // SAFETY: just made.
        let requirements = unsafe { device.get_image_memory_requirements(image) };
        let of_image = host.allocate(requirements, MemoryLocation::GpuOnly, false);
        // SAFETY: memory as required, bound once.
        unsafe { device.bind_image_memory(image, of_image.memory(), of_image.offset()) }.unwrap();
        let range = vk::ImageSubresourceRange::default()
            .aspect_mask(aspect(format))
            .level_count(1)
            .layer_count(1);
        let info = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(range);
        // SAFETY: the image has its memory.
        let view = unsafe { device.create_image_view(&info, None) }.unwrap();
        let info = vk::BufferCreateInfo::default()
            .size(u64::from(width * height) * 4)
            .usage(vk::BufferUsageFlags::TRANSFER_DST);
        // SAFETY: a plain buffer.
        let buffer = unsafe { device.create_buffer(&info, None) }.unwrap();
        // SAFETY: just made.
        let requirements = unsafe { device.get_buffer_memory_requirements(buffer) };
        let of_buffer = host.allocate(requirements, MemoryLocation::GpuToCpu, true);
        // SAFETY: memory as required, bound once.
        unsafe { device.bind_buffer_memory(buffer, of_buffer.memory(), of_buffer.offset()) }.unwrap();
        WordImage {
            host,
            format,
            extent,
            image,
            view,
            buffer,
            memory: vec![of_image, of_buffer],
        }
    }

    /// The image as the engine's, whose contents before do not matter, and which the host copies afterwards.
    pub(crate) fn target(&self) -> HostImage {
        let desc = HostImageDesc {
            image: self.image,
            view: self.view,
            format: self.format,
            extent: self.extent,
            before: FRESH,
            after: COPYABLE,
        };
        // SAFETY: image and view live until the frame has been waited for.
        unsafe { HostImage::wrap(desc) }
    }

    /// Records a copy of the image, without a barrier of the host before it.
    pub(crate) fn download(&self, commands: vk::CommandBuffer) {
        let [width, height] = self.extent;
        let regions = [vk::BufferImageCopy::default()
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: aspect(self.format),
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
            self.host
                .device
                .cmd_copy_image_to_buffer(commands, self.image, COPYABLE.layout, self.buffer, &regions);
        }
    }

    /// The words, once the frame has been waited for.
    pub(crate) fn words<T: bytemuck::Pod>(&self) -> Vec<T> {
        let pixels = (self.extent[0] * self.extent[1]) as usize;
        bytemuck::pod_collect_to_vec(&self.memory[1].mapped_slice().unwrap()[..4 * pixels])
    }
}

impl Drop for WordImage<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        let device = &self.host.device;
        // SAFETY: the frames that used it have been waited for.
        unsafe {
            device.destroy_image_view(self.view, None);
            device.destroy_image(self.image, None);
            device.destroy_buffer(self.buffer, None);
        }
        self.memory.drain(..).for_each(|memory| self.host.free(memory));
    }
}
