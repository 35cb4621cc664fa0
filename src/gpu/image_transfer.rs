//! Creation, clearing and copying of owned images.

use super::buffer::Buffer;
use super::device::Gpu;
use super::image::{Image, ImageState, OwnImage, WHOLE, extent3};
use super::recorder::Recorder;
use crate::shader::Access;
use crate::{Error, Result};
use ash::vk;
use ash::vk::Handle;
use std::sync::Arc;

/// State of a new image.
const FRESH: ImageState = ImageState {
    layout: vk::ImageLayout::UNDEFINED,
    stage: vk::PipelineStageFlags2::NONE,
    access: vk::AccessFlags2::NONE,
};
/// State before and after every command.
pub(super) const READY: ImageState = ImageState {
    layout: vk::ImageLayout::GENERAL,
    stage: vk::PipelineStageFlags2::ALL_COMMANDS,
    access: vk::AccessFlags2::from_raw(
        vk::AccessFlags2::MEMORY_READ.as_raw() | vk::AccessFlags2::MEMORY_WRITE.as_raw(),
    ),
};
/// State during a copy to a buffer.
const READ: ImageState = ImageState {
    layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_READ,
};

impl Gpu {
    /// New storage image of `[width, height]` pixels of four floats. Its pixels are undefined; with validation they are
    /// NaNs.
    ///
    /// # Errors
    /// [`Error::Config`] for a side of 0 or beyond [`Caps::max_image_side`](super::Caps::max_image_side),
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
            aspects: vk::ImageAspectFlags::COLOR,
            layer: 0,
            layout: READY.layout,
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

    /// Pixels of an owned image, row by row; blocks.
    ///
    /// # Errors
    /// Those of [`Gpu::room`] for the pixels, and of transfers.
    pub fn download_image(&self, image: &Image) -> Result<Vec<[f32; 4]>> {
        let pixels = self.room("pixels", image.pixels())?;
        self.run(|rec| rec.copy_image(image, &pixels))?;
        self.download(&pixels, 0..pixels.len())
    }
}

impl Recorder<'_> {
    /// Sets every channel of every pixel of an owned image.
    pub fn clear(&mut self, image: &Image, value: f32) {
        self.access(&[(image.image.as_raw(), Access::Write)]);
        self.keep_image(image);
        let color = vk::ClearColorValue { float32: [value; 4] };
        let (layout, device) = (READY.layout, &self.gpu.0.device);
        // SAFETY: the frame keeps the image, which is in this layout between commands.
        unsafe {
            device.cmd_clear_color_image(self.commands, image.image, layout, &color, &[WHOLE]);
        }
    }

    /// Copies all pixels of an owned image, row by row.
    pub fn copy_image(&mut self, image: &Image, to: &Buffer<[f32; 4]>) {
        assert!(image.pixels() <= to.len(), "{to:?} is too short for {image:?}");
        let to_id = to.raw.handle.as_raw();
        self.access(&[(image.image.as_raw(), Access::ReadWrite), (to_id, Access::Write)]);
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
        // SAFETY: in bounds (asserted), both are alive until the frame is done, and the image was just transitioned to
        // this layout.
        unsafe {
            device.cmd_copy_image_to_buffer(self.commands, image.image, layout, to, &regions);
        }
        self.transition(image, READ, READY);
    }

    /// Keeps an owned image alive until the frame is done. Panics for a host's image: its layout is the host's.
    fn keep_image(&mut self, image: &Image) {
        match &image.own {
            Some(own) => self.slot.keep(own.clone()),
            None => panic!("{image:?} is a host's"),
        }
    }
}
