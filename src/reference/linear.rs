//! Vectors and 3 × 3 matrices over any [`Real`]; matrices are arrays of rows.

use super::Real;
use glam::{DMat3, DVec3};

/// Three components.
pub type Vec3<R> = [R; 3];
/// Rows of three components.
pub type Mat3<R> = [[R; 3]; 3];

/// A constant vector.
pub fn vector<R: Real>(v: DVec3) -> Vec3<R> {
    v.to_array().map(R::of)
}

/// A constant matrix.
pub fn matrix<R: Real>(m: DMat3) -> Mat3<R> {
    // glam stores columns: those of the transpose are the rows.
    m.transpose().to_cols_array_2d().map(|row| row.map(R::of))
}

/// `a + b`.
pub fn add<R: Real>(a: Vec3<R>, b: Vec3<R>) -> Vec3<R> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
pub fn sub<R: Real>(a: Vec3<R>, b: Vec3<R>) -> Vec3<R> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `s v`.
pub fn scale<R: Real>(s: R, v: Vec3<R>) -> Vec3<R> {
    v.map(|x| s * x)
}

/// Scalar product.
pub fn dot<R: Real>(a: Vec3<R>, b: Vec3<R>) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
pub fn cross<R: Real>(a: Vec3<R>, b: Vec3<R>) -> Vec3<R> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// `v / |v|`.
pub fn normalize<R: Real>(v: Vec3<R>) -> Vec3<R> {
    scale(R::of(1.0) / dot(v, v).sqrt(), v)
}

/// `mᵀ`.
pub fn transpose<R: Real>(m: Mat3<R>) -> Mat3<R> {
    [0, 1, 2].map(|i| [m[0][i], m[1][i], m[2][i]])
}

/// `m v`.
pub fn transform<R: Real>(m: Mat3<R>, v: Vec3<R>) -> Vec3<R> {
    m.map(|row| dot(row, v))
}

/// `a b`.
pub fn product<R: Real>(a: Mat3<R>, b: Mat3<R>) -> Mat3<R> {
    let columns = transpose(b);
    a.map(|row| columns.map(|column| dot(row, column)))
}

/// Rotation matrix of a quaternion w, x, y, z of any length but 0.
pub fn rotation<R: Real>(quaternion: [R; 4]) -> Mat3<R> {
    // Scaled by the largest component first, so that squares neither overflow nor underflow.
    let largest = quaternion.iter().fold(0.0, |m: f64, q| m.max(q.value().abs()));
    let scaled = quaternion.map(|q| q / R::of(largest));
    let length = scaled.iter().map(|q| q.squared()).sum::<R>().sqrt();
    let [w, x, y, z] = scaled.map(|q| q / length);
    // v' = v + 2 w (u × v) + 2 u × (u × v), with u × as the matrix below.
    let zero = R::of(0.0);
    let cross = [[zero, -z, y], [z, zero, -x], [-y, x, zero]];
    let twice = product(cross, cross);
    let two = R::of(2.0);
    let mut rotation = [[zero; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            let identity = R::of(if i == j { 1.0 } else { 0.0 });
            rotation[i][j] = identity + two * (w * cross[i][j] + twice[i][j]);
        }
    }
    rotation
}

/// Covariance `Σ = R S Sᵀ Rᵀ` in the world, from quaternion and log-scales.
pub fn covariance<R: Real>(quaternion: [R; 4], log_scale: Vec3<R>) -> Mat3<R> {
    let rotation = rotation(quaternion);
    let scale = log_scale.map(|s| s.exp());
    let factor = rotation.map(|row| [row[0] * scale[0], row[1] * scale[1], row[2] * scale[2]]);
    product(factor, transpose(factor))
}
