//! Camera pose from a `transform_matrix`.

use super::super::check::Check;
use super::super::json::kind;
use super::super::pose::Pose;
use glam::{DMat3, DVec3};
use serde_json::Value;

/// Reads three or four rows of four numbers, camera to world, y up and z backward.
pub(super) fn read(matrix: &Value) -> Check<Pose> {
    let rows = parse(matrix)?;
    let column = |i: usize| DVec3::new(rows[0][i], rows[1][i], rows[2][i]);
    let linear = DMat3::from_cols(column(0), column(1), column(2));
    Pose::of_opengl(linear, column(3), "\"transform_matrix\"")
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
