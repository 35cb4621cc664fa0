//! Splats moved, rotated and scaled by a node.

use super::super::check::Check;
use super::node::Affine;
use crate::scene::{ShRotation, eigen};
use glam::{DMat3, DQuat, DVec3};

/// Most cosine between the axes of a matrix without shear. A matrix is stored with seven digits, so one is off by
/// 4e-7 at most (three products of numbers rounded by 2⁻²⁴); a chain of 25 adds up to this.
const COSINE_MAX: f64 = 1e-5;

/// Most relative difference of three scales that count as one; of the same origin.
const UNIFORM: f64 = 1e-5;

/// A splat in the axes of its mesh or of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LocalSplat {
    /// World units.
    pub(super) mean: DVec3,
    /// w, x, y, z of any length.
    pub(super) quaternion: [f32; 4],
    /// Natural logarithms; −∞ for a flat splat, NaN for a negative scale.
    pub(super) log_scale: DVec3,
}

/// Place of a mesh in the world: a rotation after positive scales of its axes.
pub(super) struct Placement {
    affine: Affine,
    rotation: DQuat,
    /// The logarithm of a scale that is the same along all axes.
    uniform: Option<f64>,
    /// Whether only the means change.
    moves_only: bool,
    harmonics: ShRotation,
}

impl Placement {
    /// Placement by a matrix, relative to an origin; refuses mirrors, shear and matrices without an inverse.
    pub(super) fn new(affine: Affine, origin: DVec3, sh_degree: u32) -> Check<Placement> {
        let linear = affine.linear;
        let axes = [linear.x_axis, linear.y_axis, linear.z_axis];
        let lengths = axes.map(DVec3::length);
        if !affine.translation.is_finite() || !lengths.iter().all(|length| length.is_finite()) {
            return Err("its matrix is not finite".into());
        }
        // Squares of smaller numbers, and of larger ones, leave the range of numbers.
        if !lengths.iter().all(|length| (1e-100..1e100).contains(length)) {
            let [x, y, z] = lengths;
            return Err(format!("its scale {x}, {y}, {z} leaves no volume, or is beyond 1e100"));
        }
        let units = DMat3::from_cols(axes[0] / lengths[0], axes[1] / lengths[1], axes[2] / lengths[2]);
        let cosines = [(0, 1), (0, 2), (1, 2)].map(|(a, b)| units.col(a).dot(units.col(b)).abs());
        if cosines.iter().any(|cosine| *cosine > COSINE_MAX) {
            return Err("its matrix shears, which has no meaning for harmonics".into());
        }
        if units.determinant() < 0.0 {
            return Err("its matrix mirrors, which has no meaning for harmonics".into());
        }
        let rotation = DQuat::from_mat3(&units).normalize();
        let mean = lengths.iter().sum::<f64>() / 3.0;
        let is_uniform = lengths.iter().all(|length| (length / mean - 1.0).abs() <= UNIFORM);
        Ok(Placement {
            affine: Affine {
                linear,
                translation: affine.translation - origin,
            },
            rotation,
            uniform: is_uniform.then(|| mean.ln()),
            moves_only: linear == DMat3::IDENTITY,
            harmonics: ShRotation::new(DMat3::from_quat(rotation), sh_degree),
        })
    }

    /// Mean in the world, relative to the origin.
    pub(super) fn mean(&self, mean: DVec3) -> DVec3 {
        match self.moves_only {
            // A zero keeps its sign.
            true if self.affine.translation == DVec3::ZERO => mean,
            true => mean + self.affine.translation,
            false => self.affine.linear * mean + self.affine.translation,
        }
    }

    /// Splat in the world.
    pub(super) fn apply(&self, splat: &LocalSplat) -> LocalSplat {
        let mean = self.mean(splat.mean);
        if self.moves_only {
            return LocalSplat { mean, ..*splat };
        }
        let [w, x, y, z] = splat.quaternion.map(f64::from);
        let own = DQuat::from_xyzw(x, y, z, w);
        let (quaternion, log_scale) = match self.uniform {
            Some(log) => (self.rotation * own, splat.log_scale + log),
            None => {
                // Σ = A R S S Rᵀ Aᵀ has the new axes and scales.
                let scale = DMat3::from_diagonal(splat.log_scale.exp());
                let factor = self.affine.linear * DMat3::from_quat(own.normalize()) * scale;
                let (variances, axes) = eigen(factor * factor.transpose());
                // A flat splat's variance is zero but for rounding. Scales that are not finite stay so.
                let variances = match factor.is_finite() {
                    true => variances.max(DVec3::ZERO),
                    false => DVec3::NAN,
                };
                (DQuat::from_mat3(&axes), variances.ln() / 2.0)
            }
        };
        LocalSplat {
            mean,
            quaternion: [quaternion.w, quaternion.x, quaternion.y, quaternion.z].map(|v| v as f32),
            log_scale,
        }
    }

    /// Rotates the harmonics `[coefficient][rgb]` of a splat.
    pub(super) fn rotate_harmonics(&self, sh: &mut [f32]) {
        if !self.moves_only {
            self.harmonics.apply(sh);
        }
    }
}
