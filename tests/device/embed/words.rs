//! Image of a host with a word a pixel, into which the engine copies.

use crate::embed::frame::COPYABLE;
use crate::embed::host::Host;
use crate::embed::texels::{Texels, TexelsDesc};
use ash::vk;
use ashfall::gpu::{HostImage, HostImageDesc, ImageState};
use gpu_allocator::MemoryLocation;

/// State of a new image, before the engine's copy.
const FRESH: ImageState = ImageState {
    layout: vk::ImageLayout::UNDEFINED,
    stage: vk::PipelineStageFlags2::NONE,
    access: vk::AccessFlags2::NONE,
};

pub(crate) struct WordImage<'a> {
    host: &'a Host,
    texels: Texels<'a>,
}

impl<'a> WordImage<'a> {
    pub(crate) fn new(host: &'a Host, format: vk::Format, extent: [u32; 2]) -> WordImage<'a> {
        use vk::ImageUsageFlags as Usage;
        let desc = TexelsDesc {
            format,
            extent,
            layers: 1,
            usage: Usage::SAMPLED | Usage::TRANSFER_SRC | Usage::TRANSFER_DST,
            texel_bytes: 4,
            location: MemoryLocation::GpuToCpu,
        };
        let texels = Texels::new(host, desc);
        WordImage { host, texels }
    }

    /// The image as the engine's, whose contents before do not matter, and which the host copies afterwards.
    pub(crate) fn target(&self) -> HostImage {
        self.target_after(FRESH)
    }

    /// As [`WordImage::target`], after another picture.
    pub(crate) fn again(&self) -> HostImage {
        self.target_after(ImageState {
            access: vk::AccessFlags2::NONE,
            ..COPYABLE
        })
    }

    fn target_after(&self, before: ImageState) -> HostImage {
        let desc = HostImageDesc {
            image: self.texels.image,
            view: self.texels.views[0],
            format: self.texels.desc.format,
            extent: self.texels.desc.extent,
            before,
            after: COPYABLE,
        };
        // SAFETY: image and view live until the frame has been waited for.
        unsafe { HostImage::wrap(desc) }
    }

    /// Records a copy of the image, without a barrier of the host before it.
    pub(crate) fn download(&self, commands: vk::CommandBuffer) {
        let (texels, regions) = (&self.texels, [self.texels.region()]);
        let device = &self.host.device;
        // SAFETY: the host's own objects; the commands are being recorded.
        unsafe {
            device.cmd_copy_image_to_buffer(commands, texels.image, COPYABLE.layout, texels.buffer, &regions);
        }
    }

    /// The words, once the frame has been waited for.
    pub(crate) fn words<T: bytemuck::Pod>(&self) -> Vec<T> {
        bytemuck::pod_collect_to_vec(self.texels.bytes())
    }
}
