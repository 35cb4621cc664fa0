//! Readers and writers of files: photographs, reconstructions, splats, meshes, checkpoints, images.
//!
//! Contract of every reader: files are untrusted. Counts are compared with the file's size before anything is
//! allocated, names never lead out of the data set's folder, and every fault is an [`Error`](crate::Error) that names
//! the file and the place. Every repair is reported in a warning. A reader takes a path or, as a [`Source`], bytes in
//! memory. Every writer goes through [`atomic`], so that a crash leaves the old file or the new one.
//!
//! **Invariant:** no Vulkan, no environment variables, no global state.
//!
#![doc = include_str!("../../docs/formats.md")]

pub mod atomic;
#[cfg(feature = "train")]
pub mod camera_path;
mod check;
#[cfg(feature = "train")]
pub mod checkpoint;
#[cfg(feature = "train")]
pub mod colmap;
#[cfg(feature = "train")]
pub mod dataset;
#[cfg(feature = "train")]
pub mod exr;
pub mod gltf;
#[cfg(feature = "train")]
mod json;
pub mod ksplat;
#[cfg(feature = "train")]
mod listing;
mod loaded;
#[cfg(feature = "train")]
mod lock;
#[cfg(feature = "train")]
pub mod mesh;
#[cfg(feature = "train")]
pub mod metashape;
#[cfg(feature = "train")]
pub mod obj;
#[cfg(feature = "train")]
pub(crate) mod parallel;
#[cfg(feature = "train")]
pub mod photo;
#[cfg(feature = "train")]
mod photo_index;
pub mod ply;
#[cfg(feature = "train")]
pub mod png;
#[cfg(feature = "train")]
mod pose;
mod reader;
#[cfg(feature = "train")]
pub mod realitycapture;
#[cfg(feature = "train")]
pub mod refined;
#[cfg(feature = "train")]
pub mod sog;
mod source;
pub mod splat32;
pub mod splats;
pub mod spz;
#[cfg(feature = "train")]
pub mod transforms;
#[cfg(feature = "train")]
pub mod video;
#[cfg(feature = "train")]
mod xml;

#[cfg(feature = "train")]
pub use listing::{ListedView, Listing};
pub use loaded::{AxesBy, LoadedSplats, StoredAs};
#[cfg(feature = "train")]
pub use lock::FolderLock;
pub use source::Source;
