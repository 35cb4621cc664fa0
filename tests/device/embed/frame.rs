//! Host-owned objects of one frame: commands, a fence, a target image, and a readback buffer.

use crate::embed::host::Host;
use crate::embed::texels::{Texels, TexelsDesc};
use ash::vk;
use ashfall::gpu::{HostImage, HostImageDesc, ImageState};
use gpu_allocator::MemoryLocation;

/// State of the image after the host's clear command.
pub(crate) const CLEARED: ImageState = ImageState {
    layout: vk::ImageLayout::TRANSFER_DST_OPTIMAL,
    stage: vk::PipelineStageFlags2::CLEAR,
    access: vk::AccessFlags2::TRANSFER_WRITE,
};
/// State of an image after its upload, before which nothing waits for it.
pub(crate) const UPLOADED: ImageState = ImageState {
    layout: vk::ImageLayout::TRANSFER_DST_OPTIMAL,
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_WRITE,
};
/// State required by the host's copy command.
pub(crate) const COPYABLE: ImageState = ImageState {
    layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_READ,
};

pub(crate) struct Frame<'a> {
    host: &'a Host,
    pool: vk::CommandPool,
    pub(crate) commands: vk::CommandBuffer,
    fence: vk::Fence,
    texels: Texels<'a>,
}

impl<'a> Frame<'a> {
    pub(crate) fn new(host: &'a Host, format: vk::Format, extent: [u32; 2]) -> Frame<'a> {
        Frame::with_layers(host, format, extent, 1)
    }

    pub(crate) fn with_layers(host: &'a Host, format: vk::Format, extent: [u32; 2], layers: u32) -> Frame<'a> {
        let device = &host.device;
        let signaled = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
        let reset = vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER;
        let pool_info = vk::CommandPoolCreateInfo::default().flags(reset);
        // SAFETY: plain objects of the host's own device.
        let (pool, fence) = unsafe {
            (
                device.create_command_pool(&pool_info, None).unwrap(),
                device.create_fence(&signaled, None).unwrap(),
            )
        };
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .command_buffer_count(1);
        // SAFETY: the pool was just made.
        let commands = unsafe { device.allocate_command_buffers(&info) }.unwrap()[0];
        use vk::ImageUsageFlags as Usage;
        let desc = TexelsDesc {
            format,
            extent,
            layers,
            usage: Usage::STORAGE | Usage::SAMPLED | Usage::TRANSFER_SRC | Usage::TRANSFER_DST,
            texel_bytes: 16,
            location: MemoryLocation::GpuToCpu,
        };
        Frame {
            host,
            pool,
            commands,
            fence,
            texels: Texels::new(host, desc),
        }
    }

    fn start(&self) {
        let device = &self.host.device;
        // SAFETY: the host's own objects; the fence has ended their last use.
        unsafe {
            device.wait_for_fences(&[self.fence], true, u64::MAX).unwrap();
            device.reset_fences(&[self.fence]).unwrap();
            device
                .begin_command_buffer(self.commands, &vk::CommandBufferBeginInfo::default())
                .unwrap();
        }
    }

    /// Records the transition of the image, whose contents are lost, to a state.
    fn discard(&self, to: ImageState) {
        let barriers = [vk::ImageMemoryBarrier2::default()
            .dst_stage_mask(to.stage)
            .dst_access_mask(to.access)
            .new_layout(to.layout)
            .image(self.texels.image)
            .subresource_range(self.texels.desc.range())];
        let dependency = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the commands are being recorded.
        unsafe { self.host.device.cmd_pipeline_barrier2(self.commands, &dependency) };
    }

    /// Waits for the frame's previous commands and begins new ones, which leave the image `UPLOADED` with these pixels.
    pub(crate) fn begin_over<T: bytemuck::Pod>(&mut self, pixels: &[T]) {
        self.start();
        let bytes: &[u8] = bytemuck::cast_slice(pixels);
        self.texels.store(bytes);
        self.discard(UPLOADED);
        let (device, regions) = (&self.host.device, [self.texels.region()]);
        // SAFETY: the host's own objects; the commands are being recorded.
        unsafe {
            device.cmd_copy_buffer_to_image(
                self.commands,
                self.texels.buffer,
                self.texels.image,
                UPLOADED.layout,
                &regions,
            );
        }
    }

    /// Waits for the frame's previous commands and begins new ones, which clear the image to red.
    pub(crate) fn begin(&self) {
        self.start();
        self.discard(CLEARED);
        let device = &self.host.device;
        let red = vk::ClearColorValue {
            float32: [1.0, 0.0, 0.0, 1.0],
        };
        // SAFETY: the host's own objects; the commands are being recorded.
        unsafe {
            device.cmd_clear_color_image(
                self.commands,
                self.texels.image,
                CLEARED.layout,
                &red,
                &[self.texels.desc.range()],
            );
        }
    }

    /// Makes the image copyable by commands of its own, for frames whose image is drawn by those of another.
    pub(crate) fn make_copyable(&self) {
        self.begin();
        self.hand_over();
        self.submit();
        self.pixels::<f32>();
    }

    /// Barrier from cleared to copyable, for frames that the engine does not record into.
    pub(crate) fn hand_over(&self) {
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(CLEARED.stage)
            .src_access_mask(CLEARED.access)
            .dst_stage_mask(COPYABLE.stage)
            .dst_access_mask(COPYABLE.access)
            .old_layout(CLEARED.layout)
            .new_layout(COPYABLE.layout)
            .image(self.texels.image)
            .subresource_range(self.texels.desc.range())];
        let dependency = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the commands are being recorded.
        unsafe { self.host.device.cmd_pipeline_barrier2(self.commands, &dependency) };
    }

    /// The image as the engine's [`HostImage`].
    pub(crate) fn target(&self, before: ImageState, after: ImageState) -> HostImage {
        self.target_as(self.texels.desc.format, self.texels.desc.extent, before, after)
    }

    /// A layer of the image.
    pub(crate) fn layer(&self, layer: u32, before: ImageState, after: ImageState) -> HostImage {
        let desc = HostImageDesc {
            image: self.texels.image,
            view: self.texels.views[layer as usize],
            format: self.texels.desc.format,
            extent: self.texels.desc.extent,
            before,
            after,
        };
        // SAFETY: image and view live as long as the frame, which waits for its commands.
        unsafe { HostImage::wrap(desc) }.at_layer(layer)
    }

    /// The image with another format and extent than its own, for refusals.
    pub(crate) fn target_as(
        &self,
        format: vk::Format,
        extent: [u32; 2],
        before: ImageState,
        after: ImageState,
    ) -> HostImage {
        let desc = HostImageDesc {
            image: self.texels.image,
            view: self.texels.views[0],
            format,
            extent,
            before,
            after,
        };
        // SAFETY: image and view live as long as the frame, which waits for its commands.
        unsafe { HostImage::wrap(desc) }
    }

    /// Copies the image, which must be `COPYABLE`, without a barrier of the host; ends and submits.
    pub(crate) fn submit(&self) {
        let device = &self.host.device;
        let regions = [self.texels.region()];
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(self.commands)];
        let submits = [vk::SubmitInfo2::default().command_buffer_infos(&buffers)];
        let to_host = [vk::MemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::COPY)
            .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::HOST)
            .dst_access_mask(vk::AccessFlags2::HOST_READ)];
        let dependency = vk::DependencyInfo::default().memory_barriers(&to_host);
        // SAFETY: the host's own objects; the commands are being recorded.
        unsafe {
            device.cmd_copy_image_to_buffer(
                self.commands,
                self.texels.image,
                COPYABLE.layout,
                self.texels.buffer,
                &regions,
            );
            device.cmd_pipeline_barrier2(self.commands, &dependency);
            device.end_command_buffer(self.commands).unwrap();
            device.queue_submit2(self.host.queue, &submits, self.fence).unwrap();
        }
    }

    /// Copies the image drawn by another frame's commands.
    pub(crate) fn resubmit(&self) {
        self.start();
        self.submit();
    }

    /// Waits for the commands, and reads the pixels of all layers.
    pub(crate) fn pixels<T: bytemuck::Pod>(&self) -> Vec<[T; 4]> {
        // SAFETY: the fence is the host's own, and was submitted or is signalled.
        unsafe { self.host.device.wait_for_fences(&[self.fence], true, u64::MAX) }.unwrap();
        let TexelsDesc { extent, layers, .. } = self.texels.desc;
        let bytes = (extent[0] * extent[1] * layers) as usize * 4 * size_of::<T>();
        let values: Vec<T> = bytemuck::pod_collect_to_vec(&self.texels.bytes()[..bytes]);
        values.chunks(4).map(|p| [p[0], p[1], p[2], p[3]]).collect()
    }
}

impl Drop for Frame<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        let device = &self.host.device;
        // SAFETY: the fence ends the last use of everything.
        unsafe {
            device.wait_for_fences(&[self.fence], true, u64::MAX).unwrap();
            device.destroy_fence(self.fence, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}
