//! Image of a host with its memory, and a buffer for its texels.

use crate::embed::host::Host;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

/// An image of one mip level, and a buffer.
#[derive(Clone, Copy)]
pub(crate) struct TexelsDesc {
    pub(crate) format: vk::Format,
    pub(crate) extent: [u32; 2],
    pub(crate) layers: u32,
    pub(crate) usage: vk::ImageUsageFlags,
    /// Bytes of a texel in the buffer.
    pub(crate) texel_bytes: u32,
    pub(crate) location: MemoryLocation,
}

pub(crate) struct Texels<'a> {
    host: &'a Host,
    pub(crate) desc: TexelsDesc,
    pub(crate) image: vk::Image,
    /// View of each layer.
    pub(crate) views: Vec<vk::ImageView>,
    pub(crate) buffer: vk::Buffer,
    /// Memory of the image and of the buffer.
    memory: [Allocation; 2],
}

/// Aspects of an image of a format, and the one that is viewed and copied.
fn aspects(format: vk::Format) -> (vk::ImageAspectFlags, vk::ImageAspectFlags) {
    use vk::ImageAspectFlags as Aspect;
    match format {
        vk::Format::D24_UNORM_S8_UINT => (Aspect::DEPTH | Aspect::STENCIL, Aspect::DEPTH),
        vk::Format::D16_UNORM | vk::Format::D32_SFLOAT => (Aspect::DEPTH, Aspect::DEPTH),
        _ => (Aspect::COLOR, Aspect::COLOR),
    }
}

impl<'a> Texels<'a> {
    pub(crate) fn new(host: &'a Host, desc: TexelsDesc) -> Texels<'a> {
        let device = &host.device;
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(desc.format)
            .extent(desc.extent3())
            .mip_levels(1)
            .array_layers(desc.layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(desc.usage);
        // SAFETY: a plain image.
        let image = unsafe { device.create_image(&info, None) }.unwrap();
        // SAFETY: just made.
        let requirements = unsafe { device.get_image_memory_requirements(image) };
        let of_image = host.allocate(requirements, MemoryLocation::GpuOnly, false);
        // SAFETY: memory as required, bound once.
        unsafe { device.bind_image_memory(image, of_image.memory(), of_image.offset()) }.unwrap();
        let view = |layer: u32| {
            let range = vk::ImageSubresourceRange {
                aspect_mask: aspects(desc.format).1,
                base_array_layer: layer,
                layer_count: 1,
                ..desc.range()
            };
            let info = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(desc.format)
                .subresource_range(range);
            // SAFETY: the image has its memory.
            unsafe { device.create_image_view(&info, None) }.unwrap()
        };
        let views = (0..desc.layers).map(view).collect();
        let info = vk::BufferCreateInfo::default()
            .size(desc.bytes() as u64)
            .usage(vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST);
        // SAFETY: a plain buffer.
        let buffer = unsafe { device.create_buffer(&info, None) }.unwrap();
        // SAFETY: just made.
        let requirements = unsafe { device.get_buffer_memory_requirements(buffer) };
        let of_buffer = host.allocate(requirements, desc.location, true);
        // SAFETY: memory as required, bound once.
        unsafe { device.bind_buffer_memory(buffer, of_buffer.memory(), of_buffer.offset()) }.unwrap();
        Texels {
            host,
            desc,
            image,
            views,
            buffer,
            memory: [of_image, of_buffer],
        }
    }

    /// Stores texels in the buffer.
    pub(crate) fn store(&mut self, bytes: &[u8]) {
        self.memory[1].mapped_slice_mut().unwrap()[..bytes.len()].copy_from_slice(bytes);
    }

    /// Texels in the buffer.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.memory[1].mapped_slice().unwrap()[..self.desc.bytes()]
    }

    /// The whole image as a region of the buffer.
    pub(crate) fn region(&self) -> vk::BufferImageCopy {
        vk::BufferImageCopy::default()
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: aspects(self.desc.format).1,
                layer_count: self.desc.layers,
                ..Default::default()
            })
            .image_extent(self.desc.extent3())
    }
}

impl TexelsDesc {
    fn bytes(&self) -> usize {
        (self.extent[0] * self.extent[1] * self.layers * self.texel_bytes) as usize
    }

    fn extent3(&self) -> vk::Extent3D {
        let [width, height] = self.extent;
        vk::Extent3D {
            width,
            height,
            depth: 1,
        }
    }

    /// All layers and aspects.
    pub(crate) fn range(&self) -> vk::ImageSubresourceRange {
        vk::ImageSubresourceRange::default()
            .aspect_mask(aspects(self.format).0)
            .level_count(1)
            .layer_count(self.layers)
    }
}

impl Drop for Texels<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        let device = &self.host.device;
        // SAFETY: the frames that used them have been waited for.
        unsafe {
            self.views
                .iter()
                .for_each(|view| device.destroy_image_view(*view, None));
            device.destroy_image(self.image, None);
            device.destroy_buffer(self.buffer, None);
        }
        let memory = std::mem::take(&mut self.memory);
        memory.into_iter().for_each(|memory| self.host.free(memory));
    }
}
