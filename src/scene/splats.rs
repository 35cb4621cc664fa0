//! A set of 3D Gaussians as stored and trained: logarithms of scales and logits of opacities.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The constant spherical-harmonic basis function, 1 / (2 √π).
pub const SH_C0: f32 = 0.282_094_8;

/// Coefficients per colour channel up to `degree`: (degree + 1)².
pub const fn sh_coefficient_count(degree: u32) -> usize {
    ((degree + 1) * (degree + 1)) as usize
}

/// Opacity of a logit.
pub(crate) fn sigmoid(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

/// Logit of an opacity strictly between 0 and 1.
#[cfg(feature = "train")]
pub(crate) fn logit(opacity: f64) -> f64 {
    (opacity / (1.0 - opacity)).ln()
}

/// Kind of splat, the same for all splats of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Primitive {
    /// 3D Gaussian, an ellipse on the screen (3DGS paper, section 4).
    #[default]
    #[serde(rename = "3d")]
    Gaussian3d,
    /// Surfel: flat Gaussian in the plane of its first two axes, met by each pixel's ray (2DGS: Huang et al., "2D
    /// Gaussian Splatting for Geometrically Accurate Radiance Fields", 2024). The third scale is not drawn.
    #[serde(rename = "surfel")]
    Surfel,
}

impl Primitive {
    /// Word of `--kind`, of reports and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Primitive::Gaussian3d => "3d",
            Primitive::Surfel => "surfel",
        }
    }

    /// Number of scales that are drawn.
    pub const fn scale_count(self) -> usize {
        match self {
            Primitive::Gaussian3d => 3,
            Primitive::Surfel => 2,
        }
    }
}

/// Thickness of a surfel as a 3D Gaussian, as a share of its smaller scale: thin for every viewer, and representable in
/// every format.
const SURFEL_THICKNESS: f32 = 0.01;

/// Filter of splats on the screen, in training and later; stored in the `.ply`'s comment. Surfels have filters of their
/// own in both cases: none but a least size ([`ScreenFilter::Classic`]), or the dilation of Mip-Splatting behind the
/// hit of the ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ScreenFilter {
    /// Screen covariance dilated by 0.3 px² (3DGS paper, section 4 and its code).
    #[default]
    #[serde(rename = "default")]
    Classic,
    /// Mip-Splatting, section 5.2: 0.1 px², and opacities lowered so that no light is added.
    Mip,
}

impl ScreenFilter {
    /// Word of `--mode`, of files and reports.
    pub const fn name(self) -> &'static str {
        match self {
            ScreenFilter::Classic => "default",
            ScreenFilter::Mip => "mip",
        }
    }

    /// Variance that is added to both axes on the screen, px².
    pub fn dilation(self) -> f64 {
        match self {
            ScreenFilter::Classic => 0.3,
            ScreenFilter::Mip => 0.1,
        }
    }

    /// Whether opacities are lowered so that the dilation adds no light.
    pub fn keeps_light(self) -> bool {
        self == ScreenFilter::Mip
    }
}

/// Splats as structure of arrays; all vectors have `len()` entries but `sh`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Splats {
    /// Centre in world units.
    pub mean: Vec<[f32; 3]>,
    /// Rotation `world_from_local` as w, x, y, z; normalised on use.
    pub quaternion: Vec<[f32; 4]>,
    /// Natural logarithm of the standard deviation along each local axis, world units. The third of a surfel is finite
    /// and not drawn ([`Splats::set_thickness`]).
    pub log_scale: Vec<[f32; 3]>,
    /// Logit of the opacity.
    pub opacity_logit: Vec<f32>,
    /// `[splat][coefficient][rgb]`, `sh_coefficient_count(sh_degree) * 3` floats a splat.
    /// Colour = 0.5 + Σ coefficient · basis(direction from camera to splat), clamped at 0.
    pub sh: Vec<f32>,
    /// Highest spherical-harmonic degree stored, 0 to 3.
    pub sh_degree: u32,
    /// Kind of the splats.
    pub primitive: Primitive,
    /// Filter on the screen.
    pub filter: ScreenFilter,
    /// Origin of the means, in the coordinates of the data set's files; its cameras must have the same
    /// (`Dataset::set_origin`).
    pub origin: DVec3,
    /// Upward direction of the world, the mean one of the training cameras, if known.
    pub up: Option<DVec3>,
}

impl Splats {
    /// Number of splats.
    pub fn len(&self) -> usize {
        self.mean.len()
    }

    /// True without splats.
    pub fn is_empty(&self) -> bool {
        self.mean.is_empty()
    }

    /// The splats of these indices, in this order.
    pub fn picked(&self, indices: &[usize]) -> Splats {
        let stride = self.sh_stride();
        let rows = indices.iter().map(|&i| &self.sh[i * stride..][..stride]);
        Splats {
            mean: indices.iter().map(|&i| self.mean[i]).collect(),
            quaternion: indices.iter().map(|&i| self.quaternion[i]).collect(),
            log_scale: indices.iter().map(|&i| self.log_scale[i]).collect(),
            opacity_logit: indices.iter().map(|&i| self.opacity_logit[i]).collect(),
            sh: rows.flatten().copied().collect(),
            sh_degree: self.sh_degree,
            primitive: self.primitive,
            filter: self.filter,
            origin: self.origin,
            up: self.up,
        }
    }

    /// Highest degree with a coefficient that is not zero.
    pub fn used_sh_degree(&self) -> u32 {
        let is_used = |degree: u32| {
            let band = 3 * sh_coefficient_count(degree - 1)..3 * sh_coefficient_count(degree);
            let mut rows = self.sh.chunks_exact(self.sh_stride());
            rows.any(|row| row[band.clone()].iter().any(|&v| v != 0.0))
        };
        (1..=self.sh_degree).rev().find(|&d| is_used(d)).unwrap_or(0)
    }

    /// Leaves out harmonics above a degree.
    pub fn cut_harmonics(&mut self, sh_degree: u32) {
        if sh_degree >= self.sh_degree {
            return;
        }
        let kept = 3 * sh_coefficient_count(sh_degree);
        let rows = self.sh.chunks_exact(self.sh_stride());
        self.sh = rows.flat_map(|row| row[..kept].iter().copied()).collect();
        self.sh_degree = sh_degree;
    }

    /// Puts the splats of these indices, each once, in this order, in place.
    ///
    /// # Panics
    /// If an index is missing or beyond the splats.
    pub fn reorder(&mut self, order: &[usize]) {
        assert_eq!(order.len(), self.len(), "an index for each splat");
        let stride = self.sh_stride();
        let mut is_placed = vec![false; order.len()];
        for start in 0..order.len() {
            // Along a cycle, each splat changes places with its successor.
            let mut to = start;
            while !is_placed[to] {
                is_placed[to] = true;
                let from = order[to];
                if from == start {
                    break;
                }
                self.mean.swap(to, from);
                self.quaternion.swap(to, from);
                self.log_scale.swap(to, from);
                self.opacity_logit.swap(to, from);
                for k in 0..stride {
                    self.sh.swap(to * stride + k, from * stride + k);
                }
                to = from;
            }
        }
        assert!(is_placed.iter().all(|placed| *placed), "every index once");
    }

    /// Gives surfels their thickness as 3D Gaussians, 1 % of the smaller scale, in the third scale; 3D Gaussians stay.
    pub fn set_thickness(&mut self) {
        if self.primitive == Primitive::Surfel {
            for [u, v, thickness] in &mut self.log_scale {
                *thickness = u.min(*v) + SURFEL_THICKNESS.ln();
            }
        }
    }

    /// The same scene of 3D Gaussians: surfels have their thickness ([`Splats::set_thickness`]).
    pub fn into_3d(mut self) -> Splats {
        self.set_thickness();
        self.primitive = Primitive::Gaussian3d;
        self
    }

    /// Floats of `sh` per splat.
    pub fn sh_stride(&self) -> usize {
        sh_coefficient_count(self.sh_degree) * 3
    }

    /// Whether all numbers of a splat are finite.
    pub fn is_finite(&self, splat: usize) -> bool {
        let stride = self.sh_stride();
        let [mean, scale] = [&self.mean[splat], &self.log_scale[splat]];
        let geometry = mean.iter().chain(scale).chain(&self.quaternion[splat]);
        let sh = &self.sh[splat * stride..][..stride];
        self.opacity_logit[splat].is_finite() && geometry.chain(sh).all(|v| v.is_finite())
    }

    /// Splats with a number that is not finite, which rendering leaves out; `None` if there are none.
    pub fn not_finite(&self) -> Option<NotFinite> {
        let mut found = (0..self.len()).filter(|&i| !self.is_finite(i));
        let first = found.next()?;
        let count = 1 + found.count();
        Some(NotFinite { count, first })
    }
}

/// Splats with a number that is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotFinite {
    /// Their number.
    pub count: usize,
    /// Index of the first.
    pub first: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splats_are_reordered_as_they_are_picked() {
        let count = 50;
        let splats = Splats {
            mean: (0..count).map(|i| [i as f32; 3]).collect(),
            quaternion: (0..count).map(|i| [i as f32; 4]).collect(),
            log_scale: (0..count).map(|i| [i as f32; 3]).collect(),
            opacity_logit: (0..count).map(|i| i as f32).collect(),
            sh: (0..12 * count).map(|i| i as f32).collect(),
            sh_degree: 1,
            ..Splats::default()
        };
        for factor in [1, 7, 13, 49] {
            let order: Vec<usize> = (0..count).map(|i| (i * factor + 3) % count).collect();
            let mut moved = splats.clone();
            moved.reorder(&order);
            assert_eq!(moved, splats.picked(&order), "{factor}");
        }
    }

    #[test]
    fn numbers_that_are_none_are_found_in_every_parameter() {
        let sound = Splats {
            mean: vec![[0.0; 3]; 3],
            quaternion: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            log_scale: vec![[f32::MAX; 3]; 3],
            opacity_logit: vec![-f32::MAX; 3],
            sh: vec![1e-45; 3 * 12],
            sh_degree: 1,
            ..Splats::default()
        };
        assert_eq!(sound.not_finite(), None);
        for parameter in 0..11 + 12 {
            for none in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut splats = sound.clone();
                match parameter {
                    0..3 => splats.mean[1][parameter] = none,
                    3..7 => splats.quaternion[1][parameter - 3] = none,
                    7..10 => splats.log_scale[1][parameter - 7] = none,
                    10 => splats.opacity_logit[1] = none,
                    _ => splats.sh[12 + parameter - 11] = none,
                }
                let found = NotFinite { count: 1, first: 1 };
                assert_eq!(splats.not_finite(), Some(found), "parameter {parameter}");
                splats.mean[2][0] = f32::NAN;
                assert_eq!(splats.not_finite().map(|n| n.count), Some(2));
            }
        }
    }
}
