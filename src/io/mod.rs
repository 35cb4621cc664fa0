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
pub mod checkpoint;
pub mod colmap;
pub mod dataset;
pub mod exr;
pub mod gltf;
pub mod ksplat;
mod listing;
mod loaded;
mod lock;
pub mod mesh;
pub mod obj;
pub mod photo;
pub mod ply;
pub mod png;
mod reader;
pub mod refined;
pub mod sog;
mod source;
pub mod splat32;
pub mod splats;
pub mod spz;
pub mod transforms;

pub use listing::{ListedView, Listing};
pub use loaded::{AxesBy, LoadedSplats, StoredAs};
pub use lock::FolderLock;
pub use source::Source;
