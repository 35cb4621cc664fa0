//! Being a guest on somebody else's device: adopt it, record into its command buffer, write its image.
//!
//! Nothing is submitted or waited for, and the host's objects survive. Recording clobbers the bound compute
//! pipeline, descriptor set 0 of the compute bind point, and the compute push constants.
//!
//! One [`HostCommands`] is one frame: whatever records into it shares what that frame owns. The host paces
//! the frames, as it does for its own resources of each.

use super::caps::Caps;
use super::device::{Gpu, Parts, SharedAllocator};
use super::image::{Image, ImageState};
use super::options::GpuOptions;
use super::recorder::Recorder;
use super::requirements::REQUIRED;
use crate::Result;
use crate::shader::Requirement;
use ash::vk;

/// A queue of the host's that we may submit to (uploads, training), never from two threads at once.
#[derive(Clone, Copy, Debug)]
pub struct HostQueue {
    /// The queue: the one that recorded commands are submitted to as well. The host must not submit to
    /// it while a call of ours may.
    pub queue: vk::Queue,
}

/// Optional features that the host has enabled.
#[derive(Clone, Copy, Debug, Default)]
pub struct HostFeatures {
    /// `shaderStorageImageWriteWithoutFormat`, which presenting needs.
    pub storage_image_write_without_format: bool,
    /// `subgroupSizeControl`; without it, a device whose subgroups vary in size runs the variants of
    /// kernels that use none.
    pub subgroup_size_control: bool,
}

/// A host's device.
pub struct HostDevice {
    /// The instance it was made from.
    pub instance: ash::Instance,
    /// The physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device, with at least [`REQUIRED`] enabled.
    pub device: ash::Device,
    /// The family of the command buffers that we record into.
    pub queue_family: u32,
    /// For blocking transfers and training; without it, only recording works.
    pub queue: Option<HostQueue>,
    /// What of [`Requirements::optional_features`](super::Requirements::optional_features) is enabled.
    pub enabled: HostFeatures,
    /// The host's allocator; `None`: we make one.
    pub allocator: Option<SharedAllocator>,
}

impl Gpu {
    /// Works on a host's device.
    ///
    /// # Safety
    /// The handles belong together and outlive every clone of the `Gpu` and everything made from it; the
    /// features that [`REQUIRED`] lists are enabled.
    ///
    /// # Errors
    /// [`Unsupported`](crate::Error::Unsupported) for a device below Vulkan 1.3 or the limits that
    /// [`REQUIRED`] lists.
    pub unsafe fn adopt(host: HostDevice) -> Result<Gpu> {
        let mut caps = Caps::query(&host.instance, host.physical_device);
        caps.check(&REQUIRED)?;
        if !host.enabled.storage_image_write_without_format {
            caps.offers
                .remove(&Requirement::StorageImageWriteWithoutFormat);
        }
        // Only a baseline adds floats atomically: hosts are not asked to enable it.
        caps.offers.remove(&Requirement::AtomicFloatAdd);
        if !host.enabled.subgroup_size_control {
            caps.without_size_control();
        }
        let parts = Parts {
            instance: host.instance,
            physical: host.physical_device,
            device: host.device,
            caps,
            family: host.queue_family,
            queue: host.queue.map(|q| q.queue),
            allocator: host.allocator,
            own: None,
        };
        parts.into_gpu(&GpuOptions::default())
    }
}

/// A host's command buffer in the recording state: one frame.
#[derive(Debug)]
pub struct HostCommands {
    commands: vk::CommandBuffer,
    /// The rings of frames that record into it, by their timeline, and the frame that each has begun.
    begun: Vec<(vk::Semaphore, u64)>,
}

impl HostCommands {
    /// Wraps a command buffer, once for each time that it is recorded.
    ///
    /// # Safety
    /// It was allocated from the adopted device for the adopted queue family, is being recorded outside
    /// a render pass, and stays so while recorders use it. It is submitted once, and frames are submitted
    /// to one queue in the order of their recording. Before as many further frames as are in flight have
    /// been recorded, and before what recorded into it is dropped, it has run (or never will).
    pub unsafe fn wrap(commands: vk::CommandBuffer) -> HostCommands {
        HostCommands {
            commands,
            begun: Vec::new(),
        }
    }

    pub(super) fn commands(&self) -> vk::CommandBuffer {
        self.commands
    }

    /// The frame that a ring has begun here.
    pub(super) fn begun_by(&self, ring: vk::Semaphore) -> Option<u64> {
        let mut begun = self.begun.iter();
        begun.find_map(|&(known, frame)| (known == ring).then_some(frame))
    }

    /// Notes the frame that a ring begins here.
    pub(super) fn begin(&mut self, ring: vk::Semaphore, frame: u64) {
        self.begun.push((ring, frame));
    }
}

/// A host's storage image to write, with its state before and after.
#[derive(Clone, Debug)]
pub struct HostImage {
    image: Image,
    before: ImageState,
    after: ImageState,
}

impl HostImage {
    /// Wraps a colour image with one mip level and layer.
    ///
    /// # Safety
    /// Image and view are alive until the commands have run, have the storage usage, and are in the state
    /// `before` when the commands run.
    pub unsafe fn wrap(
        image: vk::Image,
        view: vk::ImageView,
        extent: [u32; 2],
        before: ImageState,
        after: ImageState,
    ) -> HostImage {
        HostImage {
            image: Image {
                image,
                view,
                extent,
                own: None,
            },
            before,
            after,
        }
    }

    /// The image as a kernel's target.
    pub fn image(&self) -> &Image {
        &self.image
    }
}

impl Recorder<'_> {
    /// Brings a host's image into the layout that kernels write in.
    pub fn acquire(&mut self, target: &HostImage) {
        self.transition(&target.image, target.before, KERNEL_WRITE);
    }

    /// Hands a host's image back in the state it asked for.
    pub fn release(&mut self, target: &HostImage) {
        self.transition(&target.image, KERNEL_WRITE, target.after);
    }

    /// Ends recording into a host's command buffer.
    ///
    /// # Errors
    /// The first error of any command recorded.
    pub fn finish(mut self) -> Result<()> {
        self.full_barrier(vk::PipelineStageFlags2::ALL_COMMANDS, true);
        self.failed.take().map_or(Ok(()), Err)
    }
}

const KERNEL_WRITE: ImageState = ImageState {
    layout: vk::ImageLayout::GENERAL,
    stage: vk::PipelineStageFlags2::COMPUTE_SHADER,
    access: vk::AccessFlags2::SHADER_STORAGE_WRITE,
};
