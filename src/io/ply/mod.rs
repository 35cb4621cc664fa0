//! `.ply` files: trained splats in the layout of the 3DGS reference code, and coloured point clouds.
//!
//! Reading follows the header: any encoding, order and number type, with foreign properties and elements skipped.
//! Missing required properties are an error that names them. Splats with a number that is not finite are dropped,
//! quaternions of length zero are read as no rotation; both are counted in a warning.

mod header;
mod read;
mod rows;
mod write;

pub use read::{read, read_points};
pub use write::write;

use crate::scene::Splats;

/// Prefix of the comment with the origin of the means: three numbers follow.
const ORIGIN: &str = "SplatOrigin:";

/// Splats read, with warnings about repairs and omissions, one sentence each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadedSplats {
    /// Splats.
    pub splats: Splats,
    /// Warnings for the user; each names the file.
    pub warnings: Vec<String>,
}
