//! Depth image of a host, filled from numbers.

use crate::embed::frame::UPLOADED;
use crate::embed::host::Host;
use crate::embed::texels::{Texels, TexelsDesc};
use ash::vk;
use ashfall::gpu::{HostImage, HostImageDesc, ImageState};
use gpu_allocator::MemoryLocation;

/// State for the host's next depth test.
pub(crate) const TESTED: ImageState = ImageState {
    layout: vk::ImageLayout::GENERAL,
    stage: vk::PipelineStageFlags2::EARLY_FRAGMENT_TESTS,
    access: vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_READ,
};

pub(crate) struct DepthImage<'a> {
    host: &'a Host,
    texels: Texels<'a>,
}

impl<'a> DepthImage<'a> {
    /// An image with these values, rounded to the format; each value as stored.
    pub(crate) fn new(
        host: &'a Host,
        format: vk::Format,
        extent: [u32; 2],
        values: &[f64],
    ) -> (DepthImage<'a>, Vec<f64>) {
        let (bytes, stored) = encode(format, values);
        let desc = TexelsDesc {
            format,
            extent,
            layers: 1,
            usage: vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST,
            texel_bytes: (bytes.len() / values.len()) as u32,
            location: MemoryLocation::CpuToGpu,
        };
        let mut texels = Texels::new(host, desc);
        texels.store(&bytes);
        (DepthImage { host, texels }, stored)
    }

    /// Records the upload, which leaves the image [`UPLOADED`].
    pub(crate) fn upload(&self, commands: vk::CommandBuffer) {
        let (device, texels) = (&self.host.device, &self.texels);
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_stage_mask(UPLOADED.stage)
            .dst_access_mask(UPLOADED.access)
            .new_layout(UPLOADED.layout)
            .image(texels.image)
            .subresource_range(texels.desc.range())];
        let dependency = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        let regions = [texels.region()];
        // SAFETY: the host's own objects; the commands are being recorded.
        unsafe {
            device.cmd_pipeline_barrier2(commands, &dependency);
            device.cmd_copy_buffer_to_image(commands, texels.buffer, texels.image, UPLOADED.layout, &regions);
        }
    }

    /// The image as the engine's, in the state after its upload.
    pub(crate) fn source(&self) -> HostImage {
        self.source_after(UPLOADED)
    }

    /// As [`DepthImage::source`], after another picture.
    pub(crate) fn again(&self) -> HostImage {
        self.source_after(TESTED)
    }

    fn source_after(&self, before: ImageState) -> HostImage {
        let desc = HostImageDesc {
            image: self.texels.image,
            view: self.texels.views[0],
            format: self.texels.desc.format,
            extent: self.texels.desc.extent,
            before,
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
