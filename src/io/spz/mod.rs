//! SPZ scenes (Niantic's `spz` library): about 20 bytes a splat in fixed steps, compressed by gzip (versions 1 to 3) or
//! zstd (version 4).
//!
//! Axes are RUB by the text of the format, and in version 4 as an extension says. Several writers store the axes of
//! `.ply` files without saying so; [`splats::read_in_axes`](super::splats::read_in_axes) overrides them.

mod codes;
mod economy;
mod extensions;
mod header;
mod read;
mod steps;
mod write;

pub use codes::{SpzCodes, SpzOptions};
pub use economy::CodeCosts;
pub use read::read;
pub use write::{LEVEL, SpzVersion};

use crate::error::Result;
use crate::scene::Splats;
use std::path::Path;

/// Writes `splats` as version 4 with the default [`SpzOptions`], atomically. The origin is left out.
///
/// # Errors
/// Those of writing the file.
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    SpzCodes::nearest(splats, &SpzOptions::default()).write(path, SpzVersion::V4, LEVEL)
}
