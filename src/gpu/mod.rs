//! Vulkan layer, independent of splats: devices, buffers, images, pipelines, command recording.
//!
//! A [`Gpu`] is a cheap handle of a device, created here or adopted from a host. [`Frames`] hands out [`Recorder`]s; a
//! recorder inserts barriers between commands with conflicting declared accesses, allocates descriptor sets from its
//! frame's arena, and keeps the resources of its commands alive until these have run.
//!
//! **Invariant:** the only `ash` and the only `unsafe` of the crate but for those of the C interface. No Gaussians, no
//! environment variables, no global state.
//!
#![doc = include_str!("../../docs/embedding.md")]
#![allow(
    unsafe_code,
    reason = "Vulkan is a C interface; this module is where it is made safe"
)]

mod buffer;
mod caps;
mod check;
mod compiled;
mod create;
mod debug;
mod descriptors;
mod device;
mod faults;
mod features;
mod frame;
mod frame_slot;
mod hazards;
mod host;
mod image;
mod image_transfer;
mod memory;
mod names;
mod options;
mod pipeline;
mod recorder;
mod requirements;
mod slot;
mod timing;
mod transfer;

/// The versions that the types of hosts are of.
pub use {ash, gpu_allocator};

pub use buffer::{Buffer, PART_ALIGNMENT};
pub use caps::{Caps, DeviceKind, Limits};
pub use create::devices;
pub use device::Gpu;
pub use faults::Faults;
pub use features::{HostFeatures, MissingStruct};
pub use frame::{Frames, Ticket};
pub use frame_slot::STAGING_BYTES;
pub use host::{HostCommands, HostDevice, HostImage, HostImageDesc, HostQueue, ImageWords};
pub use image::{Image, ImageState};
pub use memory::MemoryUse;
pub use options::GpuOptions;
pub use pipeline::Pipeline;
pub use recorder::{Readback, Recorder};
pub use requirements::{REQUIRED, Requirements};
pub use slot::{Groups, Slot};
pub use transfer::TRANSFER_BYTES;
