//! Splats on the device, as planes of vec4.

use super::blocks::Blocks;
use super::precision::Precision;
use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::scene::{NotFinite, RenderMode, Splats};

/// Planes of vec4 that splats of a degree take: three of geometry, then the harmonics.
pub const fn plane_count(sh_degree: u32) -> usize {
    Precision::Full.plane_count(sh_degree)
}

/// A scene on the device.
#[derive(Clone, Debug)]
pub struct Model {
    /// `[block][plane][splat]`: mean and opacity logit; quaternion; log-scale and standard deviation of the 3D
    /// smoothing filter (0 but in training); spherical harmonics. As halves they take fewer planes
    /// ([`Precision`]).
    pub params: Vec<Buffer<[f32; 4]>>,
    /// Which splats are in which block.
    pub blocks: Blocks,
    /// Number of splats.
    pub splat_count: usize,
    /// Degree that `params` holds.
    pub sh_degree: u32,
    /// In what numbers.
    pub precision: Precision,
    /// How the scene is to be rendered.
    pub mode: RenderMode,
    /// Splats that held a number that is not finite when they were copied here: they are not drawn, and nobody
    /// else notices them.
    pub not_finite: Option<NotFinite>,
}

impl Model {
    /// Copies a scene to the device.
    pub fn upload(gpu: &Gpu, splats: &Splats) -> Result<Model> {
        Model::upload_as(gpu, splats, Precision::Full)
    }

    /// Copies a scene to the device in other numbers, for renderers that are set up for them.
    pub fn upload_as(gpu: &Gpu, splats: &Splats, precision: Precision) -> Result<Model> {
        let model = Model::reserve(gpu, splats, precision)?;
        for block in model.blocks.of(splats.len()) {
            let planes = precision.planes_of(splats, block.splats());
            gpu.upload(&model.params[block.index], 0, &planes)?;
        }
        Ok(model)
    }

    /// Copies a scene to the device when the recorded commands run.
    pub fn record_upload(
        rec: &mut Recorder<'_>,
        splats: &Splats,
        precision: Precision,
    ) -> Result<Model> {
        let model = Model::reserve(rec.gpu(), splats, precision)?;
        for block in model.blocks.of(splats.len()) {
            let planes = precision.planes_of(splats, block.splats());
            rec.update(&model.params[block.index], 0, &planes);
        }
        Ok(model)
    }

    fn reserve(gpu: &Gpu, splats: &Splats, precision: Precision) -> Result<Model> {
        let planes = precision.plane_count(splats.sh_degree);
        let blocks = Blocks::of_planes(gpu.caps(), splats.len(), planes);
        Ok(Model {
            params: blocks.buffers(gpu, "params")?,
            blocks,
            splat_count: splats.len(),
            sh_degree: splats.sh_degree,
            precision,
            mode: splats.mode,
            not_finite: splats.not_finite(),
        })
    }
}

/// The planes of a scene, one after the other, each `splats.len()` long.
pub fn planes_from_splats(splats: &Splats) -> Vec<[f32; 4]> {
    Precision::Full.planes_of(splats, 0..splats.len())
}
