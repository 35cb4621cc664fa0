//! `.ply` files: trained splats in the layout of the 3DGS reference code, and coloured point clouds.
//!
//! Reading follows the header: any encoding, order and number type, with foreign properties and
//! elements skipped. What a splat cannot do without is named when it is missing. Splats that hold a
//! number that is not finite are dropped, quaternions of length zero are read as no rotation; both
//! are counted in a warning.

mod header;
mod read;
mod rows;
mod write;

pub use read::{read, read_points};
pub use write::write;

use crate::scene::Splats;

/// Begins the comment that says where means are counted from: three numbers follow.
const ORIGIN: &str = "SplatOrigin:";

/// What was read, and what had to be repaired or left out, one sentence each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loaded {
    /// The splats.
    pub splats: Splats,
    /// Warnings for the user; each names the file.
    pub warnings: Vec<String>,
}
