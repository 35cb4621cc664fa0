//! How a renderer is set up.

use super::accuracy::Accuracy;
use super::capacity::Capacity;
use super::compatibility::Compatibility;
use super::precision::Precision;
use crate::kernels::rasterize::Outputs;

/// How a renderer is set up.
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// Frames that may be in flight at once.
    pub frames_in_flight: usize,
    /// What it has room for from the start.
    pub capacity: Capacity,
    /// Highest spherical-harmonic degree drawn; scenes of a higher one are drawn up to it.
    pub sh_degree: u32,
    /// Whether images come with expected depth.
    pub with_depth: bool,
    /// Where frames may save work at a bounded error.
    pub accuracy: Accuracy,
    /// In what numbers the models lie on the device that it draws ([`Model::upload_as`](super::Model::upload_as)).
    pub precision: Precision,
    /// Whose rules frames are drawn by.
    pub compatibility: Compatibility,
}

impl RenderOptions {
    /// What frames leave besides their images.
    pub(crate) fn outputs(&self) -> Outputs {
        Outputs {
            depth: self.with_depth,
            ends: false,
        }
    }
}

impl Default for RenderOptions {
    fn default() -> RenderOptions {
        RenderOptions {
            frames_in_flight: 2,
            capacity: Capacity {
                isects: 1 << 18,
                ..Capacity::LEAST
            },
            sh_degree: 3,
            with_depth: false,
            accuracy: Accuracy::default(),
            precision: Precision::Full,
            compatibility: Compatibility::Engine,
        }
    }
}
