//! glTF 2.0 with splats (`KHR_gaussian_splatting`): `.gltf` and `.glb`, read; `.glb` written.
//!
//! Reading gives the splats of the default scene in world coordinates and glTF's axes (LUF: x left, y up, z front):
//! every node that instances a mesh adds its splats, moved, rotated and scaled by the product of the matrices down to
//! it, in `f64`. Attributes are those of the extension and of its drafts (`_ROTATION`, `_SCALE`; colour and opacity in
//! `COLOR_0` alone), plain or as an SPZ file inside a buffer (`KHR_gaussian_splatting_compression_spz_2`, a draft, and
//! its three earlier names).
//!
//! **Rule against bombs:** an accessor may be all zeros without a byte of the file, and a node of 30 bytes instances a
//! mesh of any size. So all instances together have at most one splat for each byte of the file and its external
//! buffers. SPZ files are bounded by the rule of that format, and together by the bytes of the file; of their splats
//! only the second and further instances count.

mod accessor;
#[cfg(feature = "train")]
mod animation;
mod attributes;
mod base64;
mod buffers;
#[cfg(feature = "train")]
mod cameras;
mod glb;
mod json;
mod node;
mod placement;
mod read;
mod write;

#[cfg(feature = "train")]
pub(super) use cameras::{cameras, is_binary};
pub use read::read;
pub use write::{byte_count, write};

/// Name of the extension, and prefix of its attributes before a colon.
const EXTENSION: &str = "KHR_gaussian_splatting";
