//! Splats on the device, as planes of vec4.

use super::blocks::Blocks;
use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::layout::GEOMETRY_PLANES;
use crate::scene::{NotFinite, RenderMode, Splats, sh_coefficient_count};
use std::ops::Range;

/// Planes of vec4 that splats of a degree take: three of geometry, then the harmonics.
pub const fn plane_count(sh_degree: u32) -> usize {
    GEOMETRY_PLANES as usize + (sh_coefficient_count(sh_degree) * 3).div_ceil(4)
}

/// A scene on the device.
#[derive(Clone, Debug)]
pub struct Model {
    /// `[block][plane][splat]`: mean and opacity logit; quaternion; log-scale and standard deviation of the 3D
    /// smoothing filter (0 but in training); spherical harmonics.
    pub params: Vec<Buffer<[f32; 4]>>,
    /// Which splats are in which block.
    pub blocks: Blocks,
    /// Number of splats.
    pub splat_count: usize,
    /// Degree that `params` holds.
    pub sh_degree: u32,
    /// How the scene is to be rendered.
    pub mode: RenderMode,
    /// Splats that held a number that is not finite when they were copied here: they are not drawn, and nobody
    /// else notices them.
    pub not_finite: Option<NotFinite>,
}

impl Model {
    /// Copies a scene to the device.
    pub fn upload(gpu: &Gpu, splats: &Splats) -> Result<Model> {
        let model = Model::reserve(gpu, splats)?;
        for block in model.blocks.of(splats.len()) {
            let planes = planes_of(splats, block.splats());
            gpu.upload(&model.params[block.index], 0, &planes)?;
        }
        Ok(model)
    }

    /// Copies a scene to the device when the recorded commands run.
    pub fn record_upload(rec: &mut Recorder<'_>, splats: &Splats) -> Result<Model> {
        let model = Model::reserve(rec.gpu(), splats)?;
        for block in model.blocks.of(splats.len()) {
            let planes = planes_of(splats, block.splats());
            rec.update(&model.params[block.index], 0, &planes);
        }
        Ok(model)
    }

    fn reserve(gpu: &Gpu, splats: &Splats) -> Result<Model> {
        let blocks = Blocks::new(gpu.caps(), splats.len(), splats.sh_degree);
        Ok(Model {
            params: blocks.buffers(gpu, "params")?,
            blocks,
            splat_count: splats.len(),
            sh_degree: splats.sh_degree,
            mode: splats.mode,
            not_finite: splats.not_finite(),
        })
    }
}

/// The planes of a scene, one after the other, each `splats.len()` long.
pub fn planes_from_splats(splats: &Splats) -> Vec<[f32; 4]> {
    planes_of(splats, 0..splats.len())
}

fn planes_of(splats: &Splats, range: Range<usize>) -> Vec<[f32; 4]> {
    let mut planes = Vec::with_capacity(range.len() * plane_count(splats.sh_degree));
    let mean = &splats.mean[range.clone()];
    planes.extend(
        mean.iter()
            .zip(&splats.opacity_logit[range.clone()])
            .map(|(m, &o)| [m[0], m[1], m[2], o]),
    );
    planes.extend_from_slice(&splats.quaternion[range.clone()]);
    let log_scale = &splats.log_scale[range.clone()];
    planes.extend(log_scale.iter().map(|s| [s[0], s[1], s[2], 0.0]));
    let stride = splats.sh_stride();
    for start in (0..stride).step_by(4) {
        planes.extend(range.clone().map(|i| {
            let row = &splats.sh[i * stride..(i + 1) * stride];
            std::array::from_fn(|lane| row.get(start + lane).copied().unwrap_or(0.0))
        }));
    }
    planes
}
