//! Swapchain and frames in flight: the guest draws into an image of the host's, which is copied to the window.

use crate::device::{Device, Picture, Pinned, RANGE};
use ash::vk::{self, AccessFlags2 as Access, ImageLayout as Layout, PipelineStageFlags2 as Stage};
use ashfall::gpu::{HostImageDesc, ImageState};
use ashfall::{HostCommands, HostImage};
use std::error::Error;

/// Frames in flight, as many as a renderer's by default.
const SLOTS: usize = 2;

pub(crate) struct Screen {
    swapchain: vk::SwapchainKHR,
    images: Vec<vk::Image>,
    /// By image: signalled when it can be shown.
    finished: Vec<vk::Semaphore>,
    pub(crate) extent: [u32; 2],
    is_bgra: bool,
    pool: vk::CommandPool,
    slots: Vec<Slot>,
    next: usize,
    photo: Option<Picture>,
}

/// Objects of one frame in flight.
struct Slot {
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    acquired: vk::Semaphore,
    picture: Option<Picture>,
}

/// Fate of a frame.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Presentation {
    Shown,
    /// Drawn, but the swapchain no longer fits the window.
    Stale,
    /// Not drawn: the swapchain no longer fits the window, or there is none.
    Missed,
    /// The surface is gone.
    Lost,
}

const fn state(layout: Layout, stage: Stage, access: Access) -> ImageState {
    ImageState { layout, stage, access }
}

const FRESH: ImageState = state(Layout::UNDEFINED, Stage::ALL_TRANSFER, Access::NONE);
const WRITTEN: ImageState = state(
    Layout::TRANSFER_DST_OPTIMAL,
    Stage::ALL_TRANSFER,
    Access::TRANSFER_WRITE,
);
const READ: ImageState = state(Layout::TRANSFER_SRC_OPTIMAL, Stage::ALL_TRANSFER, Access::TRANSFER_READ);
const SHOWN: ImageState = state(Layout::PRESENT_SRC_KHR, Stage::NONE, Access::NONE);

impl Screen {
    pub(crate) fn new(device: &Device, size: [u32; 2]) -> Result<Screen, Box<dyn Error>> {
        let vulkan = &device.handle;
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(device.family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        let signaled = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
        // SAFETY: plain objects.
        unsafe {
            let pool = vulkan.create_command_pool(&pool, None)?;
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(pool)
                .command_buffer_count(SLOTS as u32);
            let mut slots = Vec::new();
            for commands in vulkan.allocate_command_buffers(&info)? {
                slots.push(Slot {
                    commands,
                    fence: vulkan.create_fence(&signaled, None)?,
                    acquired: vulkan.create_semaphore(&Default::default(), None)?,
                    picture: None,
                });
            }
            let mut screen = Screen {
                swapchain: vk::SwapchainKHR::null(),
                images: Vec::new(),
                finished: Vec::new(),
                extent: [0; 2],
                is_bgra: false,
                pool,
                slots,
                next: 0,
                photo: None,
            };
            screen.resize(device, size)?;
            Ok(screen)
        }
    }

    /// Makes the swapchain anew. A window without pixels has none.
    pub(crate) fn resize(&mut self, device: &Device, size: [u32; 2]) -> Result<(), Box<dyn Error>> {
        device.wait();
        // SAFETY: queries; the device is idle.
        unsafe {
            let (surfaces, surface) = (&device.surfaces, device.surface);
            let can = surfaces.get_physical_device_surface_capabilities(device.physical, surface)?;
            let formats = surfaces.get_physical_device_surface_formats(device.physical, surface)?;
            // Values are display-referred: an sRGB format would encode them again.
            let plain = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];
            let format = formats.iter().find(|format| plain.contains(&format.format));
            let format = format.ok_or("the window takes neither BGRA8 nor RGBA8")?;
            let extent = match can.current_extent.width {
                u32::MAX => vk::Extent2D {
                    width: size[0],
                    height: size[1],
                },
                _ => can.current_extent,
            };
            self.extent = [extent.width, extent.height];
            self.is_bgra = format.format == vk::Format::B8G8R8A8_UNORM;
            let old = self.swapchain;
            if extent.width == 0 || extent.height == 0 {
                self.discard(device);
                return Ok(());
            }
            let most = if can.max_image_count == 0 {
                u32::MAX
            } else {
                can.max_image_count
            };
            let info = vk::SwapchainCreateInfoKHR::default()
                .surface(surface)
                .min_image_count((can.min_image_count + 1).min(most))
                .image_format(format.format)
                .image_color_space(format.color_space)
                .image_extent(extent)
                .image_array_layers(1)
                .image_usage(vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::TRANSFER_SRC)
                .pre_transform(can.current_transform)
                .composite_alpha(vk::CompositeAlphaFlagsKHR::OPAQUE)
                .present_mode(vk::PresentModeKHR::FIFO)
                .clipped(true)
                .old_swapchain(old);
            let made = device.swapchains.create_swapchain(&info, None);
            self.discard(device);
            self.swapchain = made?;
            self.images = device.swapchains.get_swapchain_images(self.swapchain)?;
            for _ in &self.images {
                self.finished
                    .push(device.handle.create_semaphore(&Default::default(), None)?);
            }
            let usage = vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC;
            for slot in &mut self.slots {
                slot.picture = Some(device.picture(self.extent, usage)?);
            }
            Ok(())
        }
    }

    /// Destroys what depends on the window's size. The device is idle.
    pub(crate) fn discard(&mut self, device: &Device) {
        device.destroy(self.slots.iter_mut().filter_map(|slot| slot.picture.take()));
        // SAFETY: the device is idle.
        unsafe {
            for semaphore in self.finished.drain(..) {
                device.handle.destroy_semaphore(semaphore, None);
            }
            device.swapchains.destroy_swapchain(self.swapchain, None);
        }
        self.swapchain = vk::SwapchainKHR::null();
    }

    /// Draws a frame by `record`, then the photograph, if any, over `photo_area` (left, top, right, bottom). A copy of
    /// what is shown goes to `copy`.
    pub(crate) fn draw(
        &mut self,
        device: &Device,
        record: impl FnOnce(&mut HostCommands, &HostImage) -> ashfall::Result<()>,
        photo_area: Option<[i32; 4]>,
        copy: Option<&Pinned>,
    ) -> Result<Presentation, Box<dyn Error>> {
        let (vulkan, slot) = (&device.handle, &self.slots[self.next]);
        let Some(picture) = &slot.picture else {
            return Ok(Presentation::Missed);
        };
        // SAFETY: the slot's objects are not in use after its fence; all images are in the stated states.
        unsafe {
            vulkan.wait_for_fences(&[slot.fence], true, u64::MAX)?;
            let acquired =
                device
                    .swapchains
                    .acquire_next_image(self.swapchain, u64::MAX, slot.acquired, vk::Fence::null());
            let (index, is_stale) = match acquired {
                Err(error) => return fate(error, Presentation::Missed),
                Ok(acquired) => acquired,
            };
            let shown = self.images[index as usize];
            vulkan.reset_fences(&[slot.fence])?;
            vulkan.begin_command_buffer(slot.commands, &vk::CommandBufferBeginInfo::default())?;
            let target = HostImage::wrap(HostImageDesc {
                image: picture.image,
                view: picture.view,
                format: vk::Format::R8G8B8A8_UNORM,
                extent: picture.extent,
                before: FRESH,
                after: READ,
            });
            // After an error, too, the commands can be submitted.
            let recorded = record(&mut HostCommands::wrap(slot.commands), &target);
            let blit = Blit {
                device,
                commands: slot.commands,
            };
            let whole = [0, 0, self.extent[0] as i32, self.extent[1] as i32];
            blit.pass(shown, FRESH, WRITTEN);
            blit.copy(picture, shown, whole);
            if let (Some(photo), Some(area)) = (&self.photo, photo_area) {
                blit.pass(shown, WRITTEN, WRITTEN);
                blit.copy(photo, shown, area);
            }
            if let Some(copy) = copy {
                blit.pass(shown, WRITTEN, READ);
                vulkan.cmd_copy_image_to_buffer(slot.commands, shown, READ.layout, copy.buffer, &[region(self.extent)]);
                blit.pass(shown, READ, SHOWN);
            } else {
                blit.pass(shown, WRITTEN, SHOWN);
            }
            vulkan.end_command_buffer(slot.commands)?;
            let finished = self.finished[index as usize];
            let result = self.submit(device, slot, finished, index);
            self.next = (self.next + 1) % SLOTS;
            recorded?;
            match result {
                Ok(false) if !is_stale => Ok(Presentation::Shown),
                Ok(_) => Ok(Presentation::Stale),
                Err(error) => fate(error, Presentation::Stale),
            }
        }
    }

    /// Submits a slot's commands and shows the image; true if the swapchain no longer fits well.
    fn submit(&self, device: &Device, slot: &Slot, finished: vk::Semaphore, index: u32) -> Result<bool, vk::Result> {
        let info = |semaphore, stage| {
            [vk::SemaphoreSubmitInfo::default()
                .semaphore(semaphore)
                .stage_mask(stage)]
        };
        let waits = info(slot.acquired, Stage::ALL_TRANSFER);
        let signals = info(finished, Stage::ALL_COMMANDS);
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(slot.commands)];
        let submits = [vk::SubmitInfo2::default()
            .wait_semaphore_infos(&waits)
            .command_buffer_infos(&commands)
            .signal_semaphore_infos(&signals)];
        let (waits, swapchains, indices) = ([finished], [self.swapchain], [index]);
        let present = vk::PresentInfoKHR::default()
            .wait_semaphores(&waits)
            .swapchains(&swapchains)
            .image_indices(&indices);
        // SAFETY: everything recorded is alive until the slot's fence.
        unsafe {
            device.handle.queue_submit2(device.queue, &submits, slot.fence)?;
            device.swapchains.queue_present(device.queue, &present)
        }
    }

    /// Takes a photograph to show over pictures, rows from the top.
    pub(crate) fn set_photo(&mut self, device: &Device, rgba: &[u8], extent: [u32; 2]) -> Result<(), Box<dyn Error>> {
        use vk::ImageUsageFlags as Usage;
        device.wait();
        device.destroy(self.photo.take());
        let mut pinned = device.pinned(rgba.len())?;
        pinned.bytes().copy_from_slice(rgba);
        let photo = device.picture(extent, Usage::TRANSFER_DST | Usage::TRANSFER_SRC | Usage::SAMPLED)?;
        let (vulkan, commands) = (&device.handle, self.slots[self.next].commands);
        let submitted = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
        let submits = [vk::SubmitInfo2::default().command_buffer_infos(&submitted)];
        let blit = Blit { device, commands };
        // SAFETY: the device is idle, and again before anything is destroyed.
        unsafe {
            vulkan.begin_command_buffer(commands, &vk::CommandBufferBeginInfo::default())?;
            blit.pass(photo.image, FRESH, WRITTEN);
            vulkan.cmd_copy_buffer_to_image(commands, pinned.buffer, photo.image, WRITTEN.layout, &[region(extent)]);
            blit.pass(photo.image, WRITTEN, READ);
            vulkan.end_command_buffer(commands)?;
            vulkan.queue_submit2(device.queue, &submits, vk::Fence::null())?;
        }
        device.wait();
        device.unpin(pinned);
        self.photo = Some(photo);
        Ok(())
    }

    /// RGB of a copy of what was shown.
    pub(crate) fn rgb(&self, copy: &[u8]) -> Vec<u8> {
        let [r, b] = if self.is_bgra { [2, 0] } else { [0, 2] };
        copy.chunks_exact(4)
            .flat_map(|pixel| [pixel[r], pixel[1], pixel[b]])
            .collect()
    }

    /// Destroys everything. The device is idle.
    pub(crate) fn destroy(&mut self, device: &Device) {
        self.discard(device);
        device.destroy(self.photo.take());
        // SAFETY: the device is idle.
        unsafe {
            for slot in self.slots.drain(..) {
                device.handle.destroy_fence(slot.fence, None);
                device.handle.destroy_semaphore(slot.acquired, None);
            }
            device.handle.destroy_command_pool(self.pool, None);
        }
    }
}

/// The frame's fate by an error of acquiring or presenting, or `outdated`.
fn fate(error: vk::Result, outdated: Presentation) -> Result<Presentation, Box<dyn Error>> {
    match error {
        vk::Result::ERROR_OUT_OF_DATE_KHR => Ok(outdated),
        vk::Result::ERROR_SURFACE_LOST_KHR => Ok(Presentation::Lost),
        other => Err(other.into()),
    }
}

fn region([width, height]: [u32; 2]) -> vk::BufferImageCopy {
    vk::BufferImageCopy::default()
        .image_subresource(LAYER)
        .image_extent(vk::Extent3D {
            width,
            height,
            depth: 1,
        })
}

const LAYER: vk::ImageSubresourceLayers = vk::ImageSubresourceLayers {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    mip_level: 0,
    base_array_layer: 0,
    layer_count: 1,
};

/// Commands that copy pictures to the window's images.
struct Blit<'a> {
    device: &'a Device,
    commands: vk::CommandBuffer,
}

impl Blit<'_> {
    /// # Safety
    /// The commands are being recorded; the image is in the state `from` when they run.
    unsafe fn pass(&self, image: vk::Image, from: ImageState, to: ImageState) {
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(from.stage)
            .src_access_mask(from.access)
            .old_layout(from.layout)
            .dst_stage_mask(to.stage)
            .dst_access_mask(to.access)
            .new_layout(to.layout)
            .image(image)
            .subresource_range(RANGE)];
        let dependency = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: as the caller says.
        unsafe { self.device.handle.cmd_pipeline_barrier2(self.commands, &dependency) };
    }

    /// Copies a whole picture, scaled, to an area (left, top, right, bottom).
    ///
    /// # Safety
    /// The commands are being recorded; the images are in the states `READ` and `WRITTEN` when they run.
    unsafe fn copy(&self, from: &Picture, to: vk::Image, [left, top, right, bottom]: [i32; 4]) {
        let corner = |x, y, z| vk::Offset3D { x, y, z };
        let [width, height] = from.extent;
        let regions = [vk::ImageBlit::default()
            .src_subresource(LAYER)
            .src_offsets([corner(0, 0, 0), corner(width as i32, height as i32, 1)])
            .dst_subresource(LAYER)
            .dst_offsets([corner(left, top, 0), corner(right, bottom, 1)])];
        let (commands, filter) = (self.commands, vk::Filter::LINEAR);
        // SAFETY: as the caller says.
        unsafe {
            let vulkan = &self.device.handle;
            vulkan.cmd_blit_image(commands, from.image, READ.layout, to, WRITTEN.layout, &regions, filter);
        }
    }
}
