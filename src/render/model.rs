//! Splats on the device, as planes of vec4.

use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::layout::GEOMETRY_PLANES;
use crate::scene::{RenderMode, Splats, sh_coefficient_count};

/// Planes of vec4 that splats of a degree take: three of geometry, then the harmonics.
pub const fn plane_count(sh_degree: u32) -> usize {
    GEOMETRY_PLANES as usize + (sh_coefficient_count(sh_degree) * 3).div_ceil(4)
}

/// A scene on the device.
#[derive(Clone, Debug)]
pub struct Model {
    /// `[plane][splat]`: mean and opacity logit; quaternion; log-scale and standard deviation of the 3D
    /// smoothing filter (0 but in training); spherical harmonics.
    pub params: Buffer<[f32; 4]>,
    /// Number of splats.
    pub splat_count: usize,
    /// Splats between two planes, at least `splat_count`.
    pub stride: usize,
    /// Degree that `params` holds.
    pub sh_degree: u32,
    /// How the scene is to be rendered.
    pub mode: RenderMode,
}

impl Model {
    /// Copies a scene to the device.
    pub fn upload(gpu: &Gpu, splats: &Splats) -> Result<Model> {
        let params = gpu.buffer_from("params", &planes_from_splats(splats))?;
        Ok(Model::of(splats, params))
    }

    /// Copies a scene to the device when the recorded commands run.
    pub fn record_upload(rec: &mut Recorder<'_>, splats: &Splats) -> Result<Model> {
        let planes = planes_from_splats(splats);
        let params = rec.gpu().buffer("params", planes.len())?;
        rec.update(&params, 0, &planes);
        Ok(Model::of(splats, params))
    }

    fn of(splats: &Splats, params: Buffer<[f32; 4]>) -> Model {
        Model {
            params,
            splat_count: splats.len(),
            stride: splats.len(),
            sh_degree: splats.sh_degree,
            mode: splats.mode,
        }
    }
}

/// The planes of a scene, one after the other, each `splats.len()` long.
pub fn planes_from_splats(splats: &Splats) -> Vec<[f32; 4]> {
    let count = splats.len();
    let mut planes = Vec::with_capacity(count * plane_count(splats.sh_degree));
    planes.extend(
        splats
            .mean
            .iter()
            .zip(&splats.opacity_logit)
            .map(|(m, &o)| [m[0], m[1], m[2], o]),
    );
    planes.extend_from_slice(&splats.quaternion);
    planes.extend(splats.log_scale.iter().map(|s| [s[0], s[1], s[2], 0.0]));
    let stride = splats.sh_stride();
    for start in (0..stride).step_by(4) {
        planes.extend((0..count).map(|i| {
            let row = &splats.sh[i * stride..(i + 1) * stride];
            std::array::from_fn(|lane| row.get(start + lane).copied().unwrap_or(0.0))
        }));
    }
    planes
}
