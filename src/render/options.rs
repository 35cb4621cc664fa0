//! Options of a renderer.

use super::accuracy::Accuracy;
use super::capacity::Capacity;
use super::compatibility::Compatibility;
use super::precision::Precision;
use crate::kernels::rasterize::Outputs;
use crate::scene::Primitive;

/// Options of a [`Renderer`](super::Renderer).
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// Frames that may be in flight at once.
    pub frames_in_flight: usize,
    /// Initial capacity.
    pub capacity: Capacity,
    /// Highest spherical-harmonic degree drawn; scenes of a higher one are drawn up to it.
    pub sh_degree: u32,
    /// True for images with the depth of the splats' means.
    pub with_depth: bool,
    /// True for images with depths and normals of surfaces ([`Surface`](super::Surface)); not by the rules of the 3DGS
    /// code.
    pub with_surface: bool,
    /// True for pictures behind a host's surfaces ([`HostDepth`](super::HostDepth)); not by the rules of the 3DGS code.
    pub with_host_depth: bool,
    /// True for pictures over a host's pixels ([`Blend`](super::Blend)).
    pub with_host_color: bool,
    /// Thresholds that save work at a bounded error.
    pub accuracy: Accuracy,
    /// Kind of the models' splats; surfels not by the rules of the 3DGS code.
    pub primitive: Primitive,
    /// Storage precision of the models ([`Model::upload_as`](super::Model::upload_as)).
    pub precision: Precision,
    /// Drawing rules.
    pub compatibility: Compatibility,
}

impl RenderOptions {
    /// Outputs besides the image.
    pub(crate) fn outputs(&self) -> Outputs {
        Outputs {
            depth: self.with_depth,
            ends: false,
            surface: self.with_surface,
            spread: false,
            limit: self.with_host_depth,
            surfels: self.primitive == Primitive::Surfel,
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
            with_surface: false,
            with_host_depth: false,
            with_host_color: false,
            accuracy: Accuracy::default(),
            primitive: Primitive::Gaussian3d,
            precision: Precision::Full,
            compatibility: Compatibility::Engine,
        }
    }
}
