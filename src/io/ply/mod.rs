//! `.ply` files: trained splats in the layout of the 3DGS reference code, and coloured point clouds.
//!
//! Reading follows the header: any encoding, order and number type, with foreign properties and elements skipped.
//! Missing required properties are an error that names them. Splats with a number that is not finite are dropped,
//! quaternions of length zero are read as no rotation; both are counted in a warning.

mod comments;
pub mod compressed;
mod header;
mod mesh;
mod read;
mod rows;
mod write;

pub use mesh::read_mesh;
pub use read::{read, read_points};
pub use write::{byte_count, write};
