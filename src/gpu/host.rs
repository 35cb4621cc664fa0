//! Work on a host's device: adopt it, record into its command buffer, write its image.
//!
//! Nothing is submitted or waited for, and the host's objects are not destroyed. Recording overwrites the bound compute
//! pipeline, descriptor set 0 of the compute bind point, and the compute push constants.
//!
//! One [`HostCommands`] is one frame: all recordings into it share the frame's resources. The host paces the frames, as
//! it does for its own per-frame resources.

use super::buffer::Buffer;
use super::caps::Caps;
use super::device::{Gpu, Parts, SharedAllocator};
use super::features::{HostFeatures, missing_texts, refuse_unmet, version};
use super::image::{Image, ImageState, extent3};
use super::options::GpuOptions;
use super::recorder::{Recorder, transition};
use super::requirements::REQUIRED;
use crate::shader::{Access, Requirement};
use crate::{Error, Result};
use ash::vk::{self, Handle};
use bytemuck::Pod;
use std::sync::Arc;

/// A host's queue for the engine's submissions (uploads, training), never from two threads at once.
#[derive(Clone, Copy, Debug)]
pub struct HostQueue {
    /// The queue that the host submits recorded commands to as well, never during a call that may submit.
    pub queue: vk::Queue,
}

/// A host's device.
pub struct HostDevice {
    /// Instance of the device.
    pub instance: ash::Instance,
    /// The physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device, with at least [`REQUIRED`] enabled.
    pub device: ash::Device,
    /// The lesser of the versions that the instance was created for and the device offers. Vulkan functions of later
    /// versions are not loaded, and calling them would abort.
    pub api_version: u32,
    /// Enabled features and extensions; [`HostFeatures::of_chain`] reads the features from `vkCreateDevice`'s chain.
    pub enabled: HostFeatures,
    /// Queue family of the command buffers to record into.
    pub queue_family: u32,
    /// Queue for blocking transfers and training; without it, only recording works.
    pub queue: Option<HostQueue>,
    /// The host's allocator; `None`: one is created.
    pub allocator: Option<SharedAllocator>,
    /// Limit of the guest's buffers and images in bytes; `None`: the device's largest heap.
    pub memory_limit: Option<u64>,
    /// The host's cache for pipelines, which outlives the guest and is synchronised by Vulkan; null for none.
    pub pipeline_cache: vk::PipelineCache,
}

impl Gpu {
    /// Adopts a host's device.
    ///
    /// # Safety
    /// The handles belong together and outlive every clone of the `Gpu` and everything made from it; version, features
    /// and extensions are as stated.
    ///
    /// # Errors
    /// [`Unsupported`](crate::Error::Unsupported), with everything of [`REQUIRED`] that is missing.
    pub unsafe fn adopt(host: HostDevice) -> Result<Gpu> {
        let mut unmet: Vec<String> = missing_texts(&host.enabled).collect();
        let offered = (
            vk::api_version_major(host.api_version),
            vk::api_version_minor(host.api_version),
        );
        if offered < REQUIRED.api {
            // Not even limits can be asked for: the query may not exist.
            unmet.insert(0, version(&REQUIRED, offered));
            refuse_unmet("the host's device", &unmet)?;
        }
        let mut caps = Caps::query(&host.instance, host.physical_device);
        unmet.splice(0..0, REQUIRED.unmet(&caps));
        refuse_unmet(&caps.name, &unmet)?;
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
            pipeline_cache: host.pipeline_cache,
            has_memory_budget: host.enabled.memory_budget,
            has_debug_utils: host.enabled.debug_utils,
            own: None,
        };
        parts.into_gpu(&GpuOptions {
            memory_limit: host.memory_limit,
            ..GpuOptions::default()
        })
    }
}

/// A host's command buffer in the recording state, for one frame.
#[derive(Debug)]
pub struct HostCommands {
    commands: vk::CommandBuffer,
    /// First ring of frames that records here, and the number of the frame that it began.
    first: Option<BegunFrame>,
    /// Further rings.
    others: Vec<BegunFrame>,
}

/// Identity of a ring, and the number of the frame that it began.
type BegunFrame = (Arc<()>, u64);

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
            first: None,
            others: Vec::new(),
        }
    }

    /// Records the transition of an image from its state `before` to `after`, for a picture that is not drawn.
    pub fn pass(&self, gpu: &Gpu, target: &HostImage) {
        transition(gpu, self.commands, &target.image, target.before, target.after);
    }

    /// True if these are the commands of a buffer.
    #[cfg(feature = "capi")]
    pub(crate) fn is_of(&self, commands: vk::CommandBuffer) -> bool {
        self.commands == commands
    }

    pub(super) fn commands(&self) -> vk::CommandBuffer {
        self.commands
    }

    /// Number of the frame that a ring has begun here.
    pub(super) fn begun_by(&self, ring: &Arc<()>) -> Option<u64> {
        let mut begun = self.first.iter().chain(&self.others);
        begun.find_map(|(known, frame)| Arc::ptr_eq(known, ring).then_some(*frame))
    }

    /// Stores the number of the frame that a ring begins here. The first ring's takes no memory.
    pub(super) fn begin(&mut self, ring: &Arc<()>, frame: u64) {
        let begun = (ring.clone(), frame);
        match self.first {
            None => self.first = Some(begun),
            Some(_) => self.others.push(begun),
        }
    }
}

/// A host's image to write or to read, with its state before and after.
#[derive(Clone, Debug)]
pub struct HostImage {
    image: Image,
    format: vk::Format,
    before: ImageState,
    after: ImageState,
}

/// A host's image with one mip level and layer, or a layer of several ([`HostImage::at_layer`]).
#[derive(Clone, Copy, Debug)]
pub struct HostImageDesc {
    /// The image, with the storage usage to be written, with the sampled usage to be read.
    pub image: vk::Image,
    /// View of it with the type 2D; of an image with depth and stencil, of its depth.
    pub view: vk::ImageView,
    /// Format of the view; of a view of depth, of the image. Kernels write it without declaring it, which the device
    /// must support for this format (`VK_FORMAT_FEATURE_2_STORAGE_WRITE_WITHOUT_FORMAT_BIT`).
    pub format: vk::Format,
    /// Width and height in pixels.
    pub extent: [u32; 2],
    /// State when the commands run. The image belongs to their queue family, or is shared by all that use it.
    pub before: ImageState,
    /// State afterwards, whether a picture was drawn or refused; its layout is not `UNDEFINED`.
    pub after: ImageState,
}

impl HostImage {
    /// Wraps an image.
    ///
    /// # Safety
    /// Image and view are as described and alive until the commands have run, and the image is in the state `before`
    /// when the commands run.
    pub unsafe fn wrap(desc: HostImageDesc) -> HostImage {
        HostImage {
            image: Image {
                image: desc.image,
                view: desc.view,
                extent: desc.extent,
                aspects: aspects(desc.format),
                layer: 0,
                layout: vk::ImageLayout::GENERAL,
                own: None,
            },
            format: desc.format,
            before: desc.before,
            after: desc.after,
        }
    }

    /// An owned image as a host's.
    #[cfg(feature = "lab")]
    pub(crate) fn of_own(image: &Image) -> HostImage {
        HostImage {
            image: image.clone(),
            format: super::image::FORMAT,
            before: super::image_transfer::READY,
            after: super::image_transfer::READY,
        }
    }

    /// The layer of an array image, of which the view is; barriers leave other layers as they are.
    pub fn at_layer(mut self, layer: u32) -> HostImage {
        self.image.layer = layer;
        self
    }

    /// Checks that kernels can write the format.
    ///
    /// # Errors
    /// [`Unsupported`](crate::Error::Unsupported).
    pub fn check_writable(&self, gpu: &Gpu) -> Result<()> {
        match gpu.0.writes_format(self.format) {
            true => Ok(()),
            false => Err(Error::Unsupported {
                what: format!(
                    "drawing to {:?}: {} does not write it without its declaration (STORAGE_WRITE_WITHOUT_FORMAT)",
                    self.format,
                    gpu.caps().name
                ),
            }),
        }
    }

    /// Checks that kernels can read the format, and that there is something to read.
    ///
    /// # Errors
    /// [`Unsupported`](crate::Error::Unsupported), and [`Config`](crate::Error::Config) for an image whose layout
    /// before is `UNDEFINED`.
    pub fn check_readable(&self, gpu: &Gpu) -> Result<()> {
        if self.before.layout == vk::ImageLayout::UNDEFINED {
            let what = "an image to read: its layout before is UNDEFINED, which discards its pixels";
            return Err(Error::Config(what.into()));
        }
        match gpu.0.reads_format(self.format) {
            true => Ok(()),
            false => Err(Error::Unsupported {
                what: format!("reading {:?}: {} does not sample it", self.format, gpu.caps().name),
            }),
        }
    }

    /// Checks that words of 32 bits can be copied to the image.
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) for a format other than those of `content`.
    pub fn check_words(&self, content: ImageWords) -> Result<()> {
        let (formats, name): (&[vk::Format], _) = match content {
            ImageWords::Depths => (&[vk::Format::D32_SFLOAT, vk::Format::R32_SFLOAT], "depths"),
            ImageWords::Ids => (&[vk::Format::R32_UINT], "splats"),
        };
        match formats.contains(&self.format) {
            true => Ok(()),
            false => Err(Error::Config(format!(
                "an image of {:?} for {name}: {formats:?} is possible",
                self.format
            ))),
        }
    }

    /// The image, for binding to a kernel that writes it.
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// The image, for binding to a kernel that reads it.
    pub fn readable(&self) -> Image {
        Image {
            layout: KERNEL_READ.layout,
            ..self.image.clone()
        }
    }
}

/// Contents of an image that words are copied to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageWords {
    /// Stored depths, of the format D32 or R32F.
    Depths,
    /// Indices of splats, of the format R32_UINT.
    Ids,
}

/// All aspects of a format.
fn aspects(format: vk::Format) -> vk::ImageAspectFlags {
    use vk::{Format, ImageAspectFlags as Aspect};
    match format {
        Format::D16_UNORM | Format::X8_D24_UNORM_PACK32 | Format::D32_SFLOAT => Aspect::DEPTH,
        Format::D16_UNORM_S8_UINT | Format::D24_UNORM_S8_UINT | Format::D32_SFLOAT_S8_UINT => {
            Aspect::DEPTH | Aspect::STENCIL
        }
        _ => Aspect::COLOR,
    }
}

impl Recorder<'_> {
    /// The commands as a host's, for a guest on this device.
    #[cfg(feature = "lab")]
    pub(crate) fn as_host(&self) -> HostCommands {
        HostCommands {
            commands: self.commands,
            first: None,
            others: Vec::new(),
        }
    }

    /// Transitions a host's image from its state `before` to that for kernel writes.
    pub fn acquire(&mut self, target: &HostImage) {
        self.transition(&target.image, target.before, KERNEL_WRITE);
    }

    /// Transitions a host's image from its state `before` to that for kernels that read and write it.
    pub fn acquire_to_blend(&mut self, target: &HostImage) {
        let state = ImageState {
            access: KERNEL_WRITE.access | KERNEL_READ.access,
            ..KERNEL_WRITE
        };
        self.transition(&target.image, target.before, state);
    }

    /// Transitions a host's image to its state `after`.
    pub fn release(&mut self, target: &HostImage) {
        self.transition(&target.image, KERNEL_WRITE, target.after);
    }

    /// Transitions a host's image from its state `before` to that for kernel reads.
    pub fn acquire_to_read(&mut self, source: &HostImage) {
        self.transition(&source.image, source.before, KERNEL_READ);
    }

    /// Transitions a host's image that kernels have read to its state `after`.
    pub fn release_read(&mut self, source: &HostImage) {
        self.transition(&source.image, KERNEL_READ, source.after);
    }

    /// Copies words, row by row, to a rectangle of `[width, height]` pixels from `[x, y]` on of a host's image, from
    /// its state `before` to its state `after`.
    ///
    /// # Panics
    /// If there are fewer words than pixels, the rectangle reaches beyond the image, or the format has other words
    /// ([`HostImage::check_words`]).
    pub fn copy_to_host<T: Pod>(&mut self, from: &Buffer<T>, target: &HostImage, [x, y]: [u32; 2], size: [u32; 2]) {
        let image = &target.image;
        let pixels = size[0] as usize * size[1] as usize;
        assert!(
            size_of::<T>() == 4 && pixels <= from.len(),
            "{from:?} is no {size:?} of {image:?}"
        );
        let is_inside = x + size[0] <= image.extent[0] && y + size[1] <= image.extent[1];
        assert!(is_inside, "{size:?} from {:?} of {image:?}", [x, y]);
        self.transition(image, target.before, COPIED);
        self.access(&[(from.raw.handle.as_raw(), Access::Read)]);
        self.slot.keep(from.raw.clone());
        let regions = [vk::BufferImageCopy::default()
            .buffer_offset(from.offset)
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: image.aspects,
                mip_level: 0,
                base_array_layer: image.layer,
                layer_count: 1,
            })
            .image_offset(vk::Offset3D {
                x: x as i32,
                y: y as i32,
                z: 0,
            })
            .image_extent(extent3(size))];
        let device = &self.gpu.0.device;
        // SAFETY: in bounds (asserted); the frame keeps the buffer, the host its image, which is in this layout.
        unsafe {
            device.cmd_copy_buffer_to_image(self.commands, from.raw.handle, image.image, COPIED.layout, &regions);
        }
        self.transition(image, COPIED, target.after);
    }

    /// Ends recording into a host's command buffer, which stays valid after an error.
    ///
    /// # Errors
    /// The first error of any command recorded.
    pub fn finish(mut self) -> Result<()> {
        self.host_barrier();
        self.failed.take().map_or(Ok(()), Err)
    }
}

const KERNEL_WRITE: ImageState = ImageState {
    layout: vk::ImageLayout::GENERAL,
    stage: vk::PipelineStageFlags2::COMPUTE_SHADER,
    access: vk::AccessFlags2::SHADER_STORAGE_WRITE,
};

const COPIED: ImageState = ImageState {
    layout: vk::ImageLayout::TRANSFER_DST_OPTIMAL,
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_WRITE,
};

const KERNEL_READ: ImageState = ImageState {
    layout: vk::ImageLayout::READ_ONLY_OPTIMAL,
    stage: vk::PipelineStageFlags2::COMPUTE_SHADER,
    access: vk::AccessFlags2::SHADER_SAMPLED_READ,
};
