//! Options of a renderer.

use super::accuracy::Accuracy;
use super::capacity::Capacity;
use super::compatibility::Compatibility;
use super::precision::Precision;
use crate::kernels::rasterize::{Outputs, SurfelMode};
use crate::scene::{Primitive, Projection};
use crate::{Error, Result};

/// Order in which splats are composited, nearest first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SplatOrder {
    /// By depth of the means along the view's z axis, as scenes are trained.
    #[default]
    Depth,
    /// By distance of the means from the camera's centre: turns of a camera leave it alone, so that nothing pops when
    /// the view turns, and pictures of one centre join. Of 3D Gaussians by this engine's rules, for pictures without
    /// depths, surfaces, splats of pixels and a host's depth, which are along z.
    Distance,
}

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
    /// True for images with the splat at which the coverage of each pixel reaches 1/2, and its depth; for picking, and
    /// for depths and splats in a host's images ([`HostTarget`](super::HostTarget)); not by the rules of the 3DGS code.
    pub with_ids: bool,
    /// True for device times of the stages of a host's pictures
    /// ([`Renderer::host_timings`](super::Renderer::host_timings)).
    pub with_timings: bool,
    /// Order of the splats.
    pub order: SplatOrder,
    /// Rays of the pixels. In an orthographic projection, harmonics are taken along the view's z axis, splats at the
    /// near plane and beyond are drawn, and a host's depth is linear. Of 3D Gaussians by this engine's rules, in the
    /// order of depth, without surfaces.
    pub projection: Projection,
    /// Thresholds that save work at a bounded error.
    pub accuracy: Accuracy,
    /// Kind of the models' splats; surfels not by the rules of the 3DGS code.
    pub primitive: Primitive,
    /// Storage precision of the models ([`Model::upload_as`](super::Model::upload_as)).
    pub precision: Precision,
    /// Drawing rules.
    pub compatibility: Compatibility,
}

impl From<Primitive> for SurfelMode {
    fn from(primitive: Primitive) -> SurfelMode {
        match primitive {
            Primitive::Gaussian3d => SurfelMode::Absent,
            Primitive::Surfel => SurfelMode::Any,
        }
    }
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
            surfels: self.primitive.into(),
            ids: self.with_ids,
        }
    }

    /// Refuses outputs and kinds that the rules of the 3DGS code, an order or a projection do not have.
    pub(crate) fn check_rules(&self) -> Result<()> {
        let asked = [
            (self.with_surface, "depths and normals of surfaces"),
            (self.primitive == Primitive::Surfel, "surfels"),
            (self.with_host_depth, "pictures behind a host's surfaces"),
            (self.with_ids, "splats of pixels"),
        ];
        let refuse = |what: &str, rule: &str| {
            Err(Error::Unsupported {
                what: format!("{what} {rule}"),
            })
        };
        let is_inria = self.compatibility == Compatibility::Inria;
        let by_distance = self.order == SplatOrder::Distance;
        if self.projection == Projection::Orthographic {
            let beyond = [
                (self.with_surface, "depths and normals of surfaces"),
                (self.primitive == Primitive::Surfel, "surfels"),
                (is_inria, "pictures by the rules of the 3DGS code"),
                (by_distance, "the order of distance"),
            ];
            if let Some((_, what)) = beyond.iter().find(|(is_asked, _)| *is_asked) {
                return refuse(what, "in an orthographic projection");
            }
        }
        match asked.iter().find(|(is_asked, _)| *is_asked) {
            Some((_, what)) if is_inria => refuse(what, "by the rules of the 3DGS code"),
            Some((_, what)) if by_distance => refuse(what, "in the order of distance"),
            _ if by_distance && is_inria => refuse("the order of distance", "by the rules of the 3DGS code"),
            _ if by_distance && self.with_depth => refuse("depths", "in the order of distance"),
            _ => Ok(()),
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
            with_ids: false,
            with_timings: false,
            order: SplatOrder::Depth,
            projection: Projection::Perspective,
            accuracy: Accuracy::default(),
            primitive: Primitive::Gaussian3d,
            precision: Precision::Full,
            compatibility: Compatibility::Engine,
        }
    }
}
