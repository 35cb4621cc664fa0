//! A set of 3D Gaussians as they are stored and trained: logarithms and logits, not their values.

use serde::{Deserialize, Serialize};

/// The constant spherical-harmonic basis function, 1 / (2 √π).
pub const SH_C0: f32 = 0.282_094_8;

/// Coefficients per colour channel up to `degree`: (degree + 1)².
pub const fn sh_coefficient_count(degree: u32) -> usize {
    ((degree + 1) * (degree + 1)) as usize
}

/// How a scene was trained to be rendered; travels in the `.ply`'s comment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RenderMode {
    /// Screen covariance dilated by 0.3 px² (3DGS paper, section 4 and its code).
    #[default]
    Default,
    /// Mip-Splatting, section 5.2: 0.1 px², and opacities lowered so that no light is added.
    Mip,
}

/// Splats as structure of arrays; all vectors have `len()` entries but `sh`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Splats {
    /// Centre in world units.
    pub mean: Vec<[f32; 3]>,
    /// Rotation `world_from_local` as w, x, y, z; normalised on use.
    pub quaternion: Vec<[f32; 4]>,
    /// Natural logarithm of the standard deviation along each local axis, world units.
    pub log_scale: Vec<[f32; 3]>,
    /// Logit of the opacity.
    pub opacity_logit: Vec<f32>,
    /// `[splat][coefficient][rgb]`, `sh_coefficient_count(sh_degree) * 3` floats a splat.
    /// Colour = 0.5 + Σ coefficient · basis(direction from camera to splat), clamped at 0.
    pub sh: Vec<f32>,
    /// Highest spherical-harmonic degree stored, 0 to 3.
    pub sh_degree: u32,
    /// How the scene is to be rendered.
    pub mode: RenderMode,
}

impl Splats {
    /// Number of splats.
    pub fn len(&self) -> usize {
        self.mean.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.mean.is_empty()
    }

    /// Floats of `sh` per splat.
    pub fn sh_stride(&self) -> usize {
        sh_coefficient_count(self.sh_degree) * 3
    }
}
