//! SOG scenes (PlayCanvas "Spatially Ordered Gaussians"): codes in lossless images, listed by `meta.json`.
//!
//! A bundle (`.sog`) is a ZIP archive of `meta.json` and the images; unbundled, the same files lie in one folder.
//! Versions 1 and 2 are read, version 2 bundles are written. Means are 16-bit codes in a logarithmic domain, rotations
//! three bytes and the number of the largest component, scales and colours indices into codebooks of 256 values, the
//! harmonics of degree 1 and up an entry of a palette whose numbers are indices of a third codebook. Axes are those of
//! 3DGS `.ply` files.
//!
//! Source: the format's page in the PlayCanvas manual; splat-transform 3.7.0 for its ambiguities.

mod archive;
mod codebook;
mod codes;
mod meta;
mod palette;
mod quantise;
mod read;
mod textures;
mod tree;
mod write;

pub use codes::{SogCodes, SogPalette};
pub use quantise::{SogOptions, usual_entries};
pub use read::read;

use crate::error::Result;
use crate::scene::Splats;
use std::path::Path;

/// Writes `splats` as a version 2 bundle with the default [`SogOptions`]. Splats with numbers that are not finite are
/// left out. The write is atomic.
///
/// # Errors
/// The file cannot be written, or the scene exceeds the largest image of the format (2²⁸ splats).
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    SogCodes::quantise(splats, &SogOptions::default()).write(path)
}
