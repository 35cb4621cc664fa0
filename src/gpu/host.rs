//! Work on a host's device: adopt it, record into its command buffer, write its image.
//!
//! Nothing is submitted or waited for, and the host's objects are not destroyed. Recording overwrites the bound compute
//! pipeline, descriptor set 0 of the compute bind point, and the compute push constants.
//!
//! One [`HostCommands`] is one frame: all recordings into it share the frame's resources. The host paces the frames, as
//! it does for its own per-frame resources.

use super::caps::Caps;
use super::device::{Gpu, Parts, SharedAllocator};
use super::image::{Image, ImageState};
use super::options::GpuOptions;
use super::recorder::Recorder;
use super::requirements::REQUIRED;
use crate::Result;
use crate::shader::Requirement;
use ash::vk;

/// A host's queue for the engine's submissions (uploads, training), never from two threads at once.
#[derive(Clone, Copy, Debug)]
pub struct HostQueue {
    /// The queue that the host submits recorded commands to as well, never during a call that may submit.
    pub queue: vk::Queue,
}

/// Optional features that the host has enabled.
#[derive(Clone, Copy, Debug, Default)]
pub struct HostFeatures {
    /// `shaderStorageImageWriteWithoutFormat`, required for presenting.
    pub storage_image_write_without_format: bool,
    /// `subgroupSizeControl`; without it, devices with varying subgroup sizes run the kernel variants without subgroup
    /// operations.
    pub subgroup_size_control: bool,
}

/// A host's device.
pub struct HostDevice {
    /// Instance of the device.
    pub instance: ash::Instance,
    /// The physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device, with at least [`REQUIRED`] enabled.
    pub device: ash::Device,
    /// Queue family of the command buffers to record into.
    pub queue_family: u32,
    /// Queue for blocking transfers and training; without it, only recording works.
    pub queue: Option<HostQueue>,
    /// Enabled [`Requirements::optional_features`](super::Requirements::optional_features).
    pub enabled: HostFeatures,
    /// The host's allocator; `None`: one is created.
    pub allocator: Option<SharedAllocator>,
}

impl Gpu {
    /// Adopts a host's device.
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
            caps.offers.remove(&Requirement::StorageImageWriteWithoutFormat);
        }
        // Only a baseline adds floats atomically, so that hosts need not enable it.
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

/// A host's command buffer in the recording state, for one frame.
#[derive(Debug)]
pub struct HostCommands {
    commands: vk::CommandBuffer,
    /// Timeline of each ring of frames that records here, and the number of the frame that it began.
    begun: Vec<(vk::Semaphore, u64)>,
}

impl HostCommands {
    /// Wraps a command buffer; to be called once per recording.
    ///
    /// # Safety
    /// The command buffer was allocated from the adopted device for the adopted queue family, is being recorded outside
    /// a render pass, and stays so while recorders use it. It is submitted once, and frames are submitted to one queue
    /// in the order of their recording. It has run (or never will) before as many further frames as are in flight have
    /// been recorded, and before the objects that recorded into it are dropped.
    pub unsafe fn wrap(commands: vk::CommandBuffer) -> HostCommands {
        HostCommands {
            commands,
            begun: Vec::new(),
        }
    }

    pub(super) fn commands(&self) -> vk::CommandBuffer {
        self.commands
    }

    /// Number of the frame that a ring has begun here.
    pub(super) fn begun_by(&self, ring: vk::Semaphore) -> Option<u64> {
        let mut begun = self.begun.iter();
        begun.find_map(|&(known, frame)| (known == ring).then_some(frame))
    }

    /// Stores the number of the frame that a ring begins here.
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

    /// The image, for binding to a kernel.
    pub fn image(&self) -> &Image {
        &self.image
    }
}

impl Recorder<'_> {
    /// Transitions a host's image from its state `before` to that for kernel writes.
    pub fn acquire(&mut self, target: &HostImage) {
        self.transition(&target.image, target.before, KERNEL_WRITE);
    }

    /// Transitions a host's image to its state `after`.
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
