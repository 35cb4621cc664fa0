//! Storage images that kernels write: the host's or owned.

use super::check::check;
use super::device::Gpu;
use crate::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use std::sync::Arc;

/// A storage image, from `HostImage::wrap` or [`Gpu::image`]. Clones share it.
#[derive(Clone, Debug)]
pub struct Image {
    pub(super) image: vk::Image,
    pub(super) view: vk::ImageView,
    pub(super) extent: [u32; 2],
    /// All aspects of its format.
    pub(super) aspects: vk::ImageAspectFlags,
    /// Array layer of the view.
    pub(super) layer: u32,
    /// Layout while a kernel uses it.
    pub(super) layout: vk::ImageLayout,
    /// Owner of image, view and memory; `None`: the host.
    pub(super) own: Option<Arc<OwnImage>>,
}

/// An image with its view and its memory; destroyed with the last handle and the last frame using it.
pub(super) struct OwnImage {
    gpu: Gpu,
    pub(super) image: vk::Image,
    pub(super) view: vk::ImageView,
    name: String,
    allocation: Option<Allocation>,
    memory: u64,
}

/// Format of owned images. RGBA as 32-bit floats: storage images of this format work on every device (Vulkan
/// specification, table of mandatory format support).
pub(super) const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// Layout, stages and accesses of an image before or after commands.
#[derive(Clone, Copy, Debug)]
pub struct ImageState {
    /// Image layout.
    pub layout: vk::ImageLayout,
    /// Stages with accesses to the image.
    pub stage: vk::PipelineStageFlags2,
    /// Kinds of access.
    pub access: vk::AccessFlags2,
}

/// The single mip level of an array layer.
pub(super) const fn whole(aspects: vk::ImageAspectFlags, layer: u32) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange {
        aspect_mask: aspects,
        base_mip_level: 0,
        level_count: 1,
        base_array_layer: layer,
        layer_count: 1,
    }
}

/// The range of owned images.
pub(super) const WHOLE: vk::ImageSubresourceRange = whole(vk::ImageAspectFlags::COLOR, 0);

impl OwnImage {
    pub(super) fn new(gpu: &Gpu, name: &str, extent: [u32; 2]) -> Result<OwnImage> {
        use vk::ImageUsageFlags as Usage;
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(FORMAT)
            .extent(extent3(extent))
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(Usage::STORAGE | Usage::SAMPLED | Usage::TRANSFER_SRC | Usage::TRANSFER_DST);
        gpu.0.creating("vkCreateImage")?;
        let device = &gpu.0.device;
        // SAFETY: a plain image within the device's limits, as `Gpu::image` has checked.
        let image = check("vkCreateImage", unsafe { device.create_image(&info, None) })?;
        gpu.0.names.name(image, name);
        let mut own = OwnImage {
            gpu: gpu.clone(),
            image,
            view: vk::ImageView::null(),
            name: name.to_owned(),
            allocation: None,
            memory: 0,
        };
        // SAFETY: the image was just made.
        let requirements = unsafe { device.get_image_memory_requirements(image) };
        let location = MemoryLocation::GpuOnly;
        let allocation = gpu.0.allocate(name, requirements, location, false)?;
        // SAFETY: memory from our allocator, as required, bound once.
        let bound = unsafe { device.bind_image_memory(image, allocation.memory(), allocation.offset()) };
        own.allocation = Some(allocation);
        own.memory = requirements.size;
        gpu.0.creating("vkBindImageMemory")?;
        check("vkBindImageMemory", bound)?;
        let info = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(FORMAT)
            .subresource_range(WHOLE);
        gpu.0.creating("vkCreateImageView")?;
        // SAFETY: the image has its memory.
        let view = unsafe { device.create_image_view(&info, None) };
        own.view = check("vkCreateImageView", view)?;
        Ok(own)
    }
}

impl std::fmt::Debug for OwnImage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "OwnImage({})", self.name)
    }
}

impl Drop for OwnImage {
    fn drop(&mut self) {
        // SAFETY: frames that use an image hold it, so no command refers to it any more; a view that was never made is
        // null, which is ignored.
        unsafe {
            self.gpu.0.device.destroy_image_view(self.view, None);
            self.gpu.0.device.destroy_image(self.image, None);
        }
        if let Some(allocation) = self.allocation.take() {
            self.gpu.0.free(allocation, &self.name, self.memory);
        }
    }
}

pub(super) fn extent3([width, height]: [u32; 2]) -> vk::Extent3D {
    vk::Extent3D {
        width,
        height,
        depth: 1,
    }
}

impl Image {
    /// Width and height in pixels.
    pub fn extent(&self) -> [u32; 2] {
        self.extent
    }

    /// Number of pixels.
    pub(super) fn pixels(&self) -> usize {
        self.extent[0] as usize * self.extent[1] as usize
    }
}
