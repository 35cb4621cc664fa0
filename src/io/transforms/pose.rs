//! Camera pose from a `transform_matrix`.

use super::super::check::Check;
use super::scope::kind;
use glam::{DMat3, DVec3};
use serde_json::Value;

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

/// Reads three or four rows of four numbers, camera to world, y up and z backward.
pub(super) fn read(matrix: &Value) -> Check<Pose> {
    let rows = parse(matrix)?;
    let column = |i: usize| DVec3::new(rows[0][i], rows[1][i], rows[2][i]);
    let linear = DMat3::from_cols(column(0), column(1), column(2));
    let determinant = linear.determinant();
    let longest = (0..3).map(|i| column(i).length()).fold(0.0, f64::max);
    if !(determinant.is_finite() && determinant.abs() > 1e-6 * longest.powi(3)) || longest < 1e-12 {
        return Err("the rotation of \"transform_matrix\" is singular".to_owned());
    }
    if determinant < 0.0 {
        return Err("the rotation of \"transform_matrix\" is a reflection".to_owned());
    }
    let scale = determinant.cbrt();
    let world_from_camera = nearest_rotation(linear * (1.0 / scale));
    let difference = linear * (1.0 / scale) - world_from_camera;
    let shear = difference.to_cols_array().map(f64::abs);
    if shear.iter().any(|d| *d > SHEAR_TOLERANCE) {
        return Err("the rotation of \"transform_matrix\" is sheared".to_owned());
    }
    // Flip y and z of the camera: from y up, z backward to y down, z forward.
    let flipped = DMat3::from_cols(
        world_from_camera.x_axis,
        -world_from_camera.y_axis,
        -world_from_camera.z_axis,
    );
    Ok(Pose {
        rotation: flipped.transpose(),
        position: column(3),
        was_scaled: (scale - 1.0).abs() > SCALE_TOLERANCE,
    })
}

fn parse(matrix: &Value) -> Result<[[f64; 4]; 3], String> {
    let shape = || "\"transform_matrix\" is not 4 rows of 4 numbers".to_owned();
    let rows = matrix.as_array().ok_or_else(shape)?;
    if !matches!(rows.len(), 3 | 4) {
        return Err(shape());
    }
    let mut numbers = [[0.0; 4]; 3];
    for (row, into) in rows.iter().zip(&mut numbers) {
        let row = row.as_array().filter(|r| r.len() == 4).ok_or_else(shape)?;
        for (value, into) in row.iter().zip(into) {
            *into = value
                .as_f64()
                .filter(|v| v.is_finite())
                .ok_or_else(|| format!("\"transform_matrix\" holds {}, not a number", kind(value)))?;
        }
    }
    Ok(numbers)
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
