//! Images that kernels write: a host's, or one of our own.

use super::buffer::Buffer;
use super::device::{Gpu, check};
use super::host::ImageState;
use super::recorder::Recorder;
use crate::shader::Access;
use crate::{Error, Result};
use ash::vk;
use ash::vk::Handle;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;
use std::sync::Arc;

/// A storage image: made by `HostImage::wrap` or by [`Gpu::image`]. Clones share it.
#[derive(Clone, Debug)]
pub struct Image {
    pub(super) image: vk::Image,
    pub(super) view: vk::ImageView,
    pub(super) extent: [u32; 2],
    /// What keeps it alive; `None`: its host does.
    pub(super) own: Option<Arc<OwnImage>>,
}

/// An image with its view and its memory; destroyed when the last handle, and the last frame using it, is gone.
pub(super) struct OwnImage {
    gpu: Gpu,
    image: vk::Image,
    view: vk::ImageView,
    name: String,
    allocation: Option<Allocation>,
    memory: u64,
}

/// Red, green, blue and alpha as floats: every device stores to such images (Vulkan specification, table of
/// mandatory format support).
const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// As it is made, ...
const FRESH: ImageState = ImageState {
    layout: vk::ImageLayout::UNDEFINED,
    stage: vk::PipelineStageFlags2::NONE,
    access: vk::AccessFlags2::NONE,
};
/// ... as every command finds and leaves it, ...
const READY: ImageState = ImageState {
    layout: vk::ImageLayout::GENERAL,
    stage: vk::PipelineStageFlags2::ALL_COMMANDS,
    access: vk::AccessFlags2::from_raw(
        vk::AccessFlags2::MEMORY_READ.as_raw() | vk::AccessFlags2::MEMORY_WRITE.as_raw(),
    ),
};
/// ... and as it is copied.
const READ: ImageState = ImageState {
    layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_READ,
};

/// The one level and the one layer that images have here.
pub(super) const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

impl OwnImage {
    fn new(gpu: &Gpu, name: &str, extent: [u32; 2]) -> Result<OwnImage> {
        use vk::ImageUsageFlags as Usage;
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(FORMAT)
            .extent(extent3(extent))
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(Usage::STORAGE | Usage::TRANSFER_SRC | Usage::TRANSFER_DST);
        gpu.0.creating("vkCreateImage")?;
        let device = &gpu.0.device;
        // SAFETY: a plain image within the device's limits, as `Gpu::image` has checked.
        let image = check("vkCreateImage", unsafe { device.create_image(&info, None) })?;
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
        let bound =
            unsafe { device.bind_image_memory(image, allocation.memory(), allocation.offset()) };
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
        // SAFETY: frames that use an image hold it, so no command refers to it any more; a view that was never
        // made is null, which is ignored.
        unsafe {
            self.gpu.0.device.destroy_image_view(self.view, None);
            self.gpu.0.device.destroy_image(self.image, None);
        }
        if let Some(allocation) = self.allocation.take() {
            self.gpu.0.free(allocation, &self.name, self.memory);
        }
    }
}

fn extent3([width, height]: [u32; 2]) -> vk::Extent3D {
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

    /// Red, green, blue and alpha of each pixel, how many there are.
    fn pixels(&self) -> usize {
        self.extent[0] as usize * self.extent[1] as usize
    }
}

impl Gpu {
    /// A storage image of our own for four floats a pixel, ready to be written. Its pixels are undefined; with
    /// validation on they are NaNs.
    ///
    /// # Errors
    /// [`Error::Config`] for a size that is nothing or more than the device's images have,
    /// [`Error::OutOfMemory`] beyond the memory limit or the device's memory.
    pub fn image(&self, name: &str, extent: [u32; 2]) -> Result<Image> {
        let most = self.caps().max_image_side;
        if extent.iter().any(|&side| side == 0 || side > most) {
            let [width, height] = extent;
            let what = format!("{name}: an image of {width}x{height}; sides are from 1 to {most}");
            return Err(Error::Config(what));
        }
        let own = Arc::new(OwnImage::new(self, name, extent)?);
        let image = Image {
            image: own.image,
            view: own.view,
            extent,
            own: Some(own),
        };
        self.run(|rec| {
            rec.keep_image(&image);
            rec.transition(&image, FRESH, READY);
            if self.0.poison {
                rec.clear(&image, f32::NAN);
            }
        })?;
        Ok(image)
    }

    /// All pixels of an image of our own, row by row; waits.
    ///
    /// # Errors
    /// Those of a buffer of as many bytes, and of transfers.
    pub fn download_image(&self, image: &Image) -> Result<Vec<[f32; 4]>> {
        let pixels = self.room("pixels", image.pixels())?;
        self.run(|rec| rec.copy_image(image, &pixels))?;
        self.download(&pixels, 0..pixels.len())
    }
}

impl Recorder<'_> {
    /// Sets every channel of every pixel of an image of our own.
    pub fn clear(&mut self, image: &Image, value: f32) {
        self.access(&[(image.image.as_raw(), Access::Write)]);
        self.keep_image(image);
        let color = vk::ClearColorValue {
            float32: [value; 4],
        };
        let (layout, device) = (READY.layout, &self.gpu.0.device);
        // SAFETY: the frame keeps the image, which is in this layout between commands.
        unsafe {
            device.cmd_clear_color_image(self.commands, image.image, layout, &color, &[WHOLE]);
        }
    }

    /// Copies all pixels of an image of our own, row by row.
    pub fn copy_image(&mut self, image: &Image, to: &Buffer<[f32; 4]>) {
        assert!(
            image.pixels() <= to.len(),
            "{to:?} is too short for {image:?}"
        );
        let to_id = to.raw.handle.as_raw();
        self.access(&[
            (image.image.as_raw(), Access::ReadWrite),
            (to_id, Access::Write),
        ]);
        self.keep_image(image);
        self.slot.keep(to.raw.clone());
        let regions = [vk::BufferImageCopy::default()
            .buffer_offset(to.offset)
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                mip_level: 0,
                base_array_layer: 0,
                layer_count: 1,
            })
            .image_extent(extent3(image.extent))];
        self.transition(image, READY, READ);
        let (layout, to, device) = (READ.layout, to.raw.handle, &self.gpu.0.device);
        // SAFETY: in bounds (asserted), both are alive until the frame is done, and the image was just brought into
        // this layout.
        unsafe {
            device.cmd_copy_image_to_buffer(self.commands, image.image, layout, to, &regions);
        }
        self.transition(image, READ, READY);
    }

    /// Of an image of our own: it must outlive the frame. Transfers take no other, whose layout is its host's.
    fn keep_image(&mut self, image: &Image) {
        match &image.own {
            Some(own) => self.slot.keep(own.clone()),
            None => panic!("{image:?} is a host's"),
        }
    }
}
