//! Composites the sorted splats of every tile as the code of the 3DGS paper does.

pub use super::generated::rasterize_inria::*;
use super::rasterize::Outputs;

impl Choice {
    /// Choice for a frame with these outputs, the same on all devices.
    pub fn of_outputs(outputs: Outputs) -> Choice {
        let mut choice = Choice::default();
        choice.spec.with_depth = outputs.depth.into();
        choice.spec.with_ends = outputs.ends.into();
        choice
    }
}
