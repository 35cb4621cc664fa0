//! Poses from matrices of files, camera to world.

use super::check::Check;
use glam::{DMat3, DVec3};

/// Deviation of the scale from 1 without a warning: the rounding of matrices written as `f32`.
const SCALE_TOLERANCE: f64 = 1e-3;

/// Largest deviation of a matrix from a rotation times a scale.
const SHEAR_TOLERANCE: f64 = 1e-2;

/// A pose in the camera axes of this crate: x right, y down, z forward.
pub(super) struct Pose {
    /// `view_from_world`, orthonormal.
    pub(super) rotation: DMat3,
    /// Camera centre.
    pub(super) position: DVec3,
    /// True if a scale was removed from the matrix.
    pub(super) was_scaled: bool,
}

impl Pose {
    /// Pose of a matrix with the camera's axes x right, y up and z backward as columns; `name` is that of the matrix.
    pub(super) fn of_opengl(linear: DMat3, position: DVec3, name: &str) -> Check<Pose> {
        let DMat3 { x_axis, y_axis, z_axis } = linear;
        Pose::of_matrix(DMat3::from_cols(x_axis, -y_axis, -z_axis), position, name)
    }

    /// Pose of a matrix with the camera's axes x right, y down and z forward as columns.
    pub(super) fn of_matrix(linear: DMat3, position: DVec3, name: &str) -> Check<Pose> {
        let (world_from_camera, scale) = rotation(linear, name)?;
        Ok(Pose {
            rotation: world_from_camera.transpose(),
            position,
            was_scaled: (scale - 1.0).abs() > SCALE_TOLERANCE,
        })
    }
}

/// Rotation and scale of a matrix.
pub(super) fn rotation(linear: DMat3, name: &str) -> Check<(DMat3, f64)> {
    let determinant = linear.determinant();
    let longest = (0..3).map(|i| linear.col(i).length()).fold(0.0, f64::max);
    if !(determinant.is_finite() && determinant.abs() > 1e-6 * longest.powi(3)) || longest < 1e-12 {
        return Err(format!("the rotation of {name} is singular"));
    }
    if determinant < 0.0 {
        return Err(format!("the rotation of {name} is a reflection"));
    }
    let scale = determinant.cbrt();
    let rotation = nearest_rotation(linear * (1.0 / scale));
    let difference = linear * (1.0 / scale) - rotation;
    let shear = difference.to_cols_array().map(f64::abs);
    // A difference that is no number is none either.
    if !shear.iter().all(|d| *d <= SHEAR_TOLERANCE) {
        return Err(format!("the rotation of {name} is sheared"));
    }
    Ok((rotation, scale))
}

/// The orthogonal factor of the polar decomposition, by Newton's iteration (Higham 1986). It converges
/// quadratically; the matrix has determinant 1 here, so a few steps are plenty.
fn nearest_rotation(matrix: DMat3) -> DMat3 {
    let mut rotation = matrix;
    for _ in 0..30 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    rotation
}
