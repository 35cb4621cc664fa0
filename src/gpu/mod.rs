//! Vulkan, and nothing of splats: devices, buffers, images, pipelines, command recording.
//!
//! A [`Gpu`] is a cheap handle of a device, created here or adopted from a host. [`Frames`] hands out
//! [`Recorder`]s; a recorder puts barriers where the declared accesses of its commands conflict, takes
//! descriptor sets from its frame's arena, and keeps alive what its commands use until they have run.
//!
//! **Invariant:** the only `ash` and the only `unsafe` of the crate. Nothing here has heard of a
//! Gaussian, reads an environment variable, or keeps global state.
//!
#![doc = include_str!("../../docs/embedding.md")]
#![allow(
    unsafe_code,
    reason = "Vulkan is a C interface; this module is where it is made safe"
)]

mod buffer;
mod caps;
mod create;
mod debug;
mod descriptors;
mod device;
mod faults;
mod frame;
mod hazards;
mod host;
mod image;
mod memory;
mod pipeline;
mod recorder;
mod timing;
mod transfer;

pub use buffer::{Buffer, PART_ALIGNMENT};
pub use caps::{Caps, DeviceKind, Limits};
pub use create::{GpuOptions, REQUIRED, Requirements, devices};
pub use device::Gpu;
pub use faults::Faults;
pub use frame::{Frames, STAGING_BYTES, Ticket};
pub use hazards::Hazards;
pub use host::{HostCommands, HostDevice, HostFeatures, HostImage, HostQueue, ImageState};
pub use image::Image;
pub use memory::MemoryUse;
pub use pipeline::Pipeline;
pub use recorder::{Groups, Readback, Recorder, Slot};
pub use transfer::TRANSFER_BYTES;
