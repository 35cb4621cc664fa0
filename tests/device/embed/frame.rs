//! Host-owned objects of one frame: commands, a fence, a target image, and a readback buffer.

use crate::embed::host::Host;
use ash::vk;
use ashfall::gpu::{HostImage, HostImageDesc, ImageState};
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

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
    image: vk::Image,
    view: vk::ImageView,
    format: vk::Format,
    extent: [u32; 2],
    buffer: vk::Buffer,
    memory: Vec<Allocation>,
}

const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

impl<'a> Frame<'a> {
    pub(crate) fn new(host: &'a Host, format: vk::Format, extent: [u32; 2]) -> Frame<'a> {
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
        let mut frame = Frame {
            host,
            pool,
            commands,
            fence,
            image: vk::Image::null(),
            view: vk::ImageView::null(),
            format,
            extent,
            buffer: vk::Buffer::null(),
            memory: Vec::new(),
        };
        frame.make_image();
        frame.make_buffer();
        frame
    }

    fn make_image(&mut self) {
        let format = self.format;
        let device = &self.host.device;
        use vk::ImageUsageFlags as Usage;
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(self.extent3())
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(Usage::STORAGE | Usage::SAMPLED | Usage::TRANSFER_SRC | Usage::TRANSFER_DST);
        // SAFETY: a plain image.
        self.image = unsafe { device.create_image(&info, None) }.unwrap();
        // SAFETY: just made.
        let requirements = unsafe { device.get_image_memory_requirements(self.image) };
        let memory = self.host.allocate(requirements, MemoryLocation::GpuOnly, false);
        // SAFETY: memory as required, bound once.
        unsafe { device.bind_image_memory(self.image, memory.memory(), memory.offset()) }.unwrap();
        self.memory.push(memory);
        let info = vk::ImageViewCreateInfo::default()
            .image(self.image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(WHOLE);
        // SAFETY: the image has its memory.
        self.view = unsafe { device.create_image_view(&info, None) }.unwrap();
    }

    fn make_buffer(&mut self) {
        let device = &self.host.device;
        let bytes = u64::from(self.extent[0]) * u64::from(self.extent[1]) * 16;
        let usage = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: a plain buffer.
        self.buffer = unsafe { device.create_buffer(&info, None) }.unwrap();
        // SAFETY: just made.
        let requirements = unsafe { device.get_buffer_memory_requirements(self.buffer) };
        let memory = self.host.allocate(requirements, MemoryLocation::GpuToCpu, true);
        // SAFETY: memory as required, bound once.
        unsafe { device.bind_buffer_memory(self.buffer, memory.memory(), memory.offset()) }.unwrap();
        self.memory.push(memory);
    }

    fn extent3(&self) -> vk::Extent3D {
        let [width, height] = self.extent;
        vk::Extent3D {
            width,
            height,
            depth: 1,
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
            .image(self.image)
            .subresource_range(WHOLE)];
        let dependency = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the commands are being recorded.
        unsafe { self.host.device.cmd_pipeline_barrier2(self.commands, &dependency) };
    }

    /// The whole image as a region of the buffer.
    fn region(&self) -> vk::BufferImageCopy {
        vk::BufferImageCopy::default()
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                layer_count: 1,
                ..Default::default()
            })
            .image_extent(self.extent3())
    }

    /// Waits for the frame's previous commands and begins new ones, which leave the image `UPLOADED` with these pixels.
    pub(crate) fn begin_over<T: bytemuck::Pod>(&mut self, pixels: &[T]) {
        self.start();
        let bytes: &[u8] = bytemuck::cast_slice(pixels);
        self.memory[1].mapped_slice_mut().unwrap()[..bytes.len()].copy_from_slice(bytes);
        self.discard(UPLOADED);
        let (device, regions) = (&self.host.device, [self.region()]);
        // SAFETY: the host's own objects; the commands are being recorded.
        unsafe {
            device.cmd_copy_buffer_to_image(self.commands, self.buffer, self.image, UPLOADED.layout, &regions);
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
            device.cmd_clear_color_image(self.commands, self.image, CLEARED.layout, &red, &[WHOLE]);
        }
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
            .image(self.image)
            .subresource_range(WHOLE)];
        let dependency = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the commands are being recorded.
        unsafe { self.host.device.cmd_pipeline_barrier2(self.commands, &dependency) };
    }

    /// The image as the engine's [`HostImage`].
    pub(crate) fn target(&self, before: ImageState, after: ImageState) -> HostImage {
        self.target_as(self.format, self.extent, before, after)
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
            image: self.image,
            view: self.view,
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
        let regions = [self.region()];
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
            device.cmd_copy_image_to_buffer(self.commands, self.image, COPYABLE.layout, self.buffer, &regions);
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

    /// Waits for the commands, and reads the pixels.
    pub(crate) fn pixels<T: bytemuck::Pod>(&self) -> Vec<[T; 4]> {
        // SAFETY: the fence is the host's own, and was submitted or is signalled.
        unsafe { self.host.device.wait_for_fences(&[self.fence], true, u64::MAX) }.unwrap();
        let bytes = (self.extent[0] * self.extent[1]) as usize * 4 * size_of::<T>();
        let values: Vec<T> = bytemuck::pod_collect_to_vec(&self.memory[1].mapped_slice().unwrap()[..bytes]);
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
            device.destroy_image_view(self.view, None);
            device.destroy_image(self.image, None);
            device.destroy_buffer(self.buffer, None);
        }
        self.memory.drain(..).for_each(|memory| self.host.free(memory));
    }
}
