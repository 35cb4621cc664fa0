//! Eigenvalues and eigenvectors of a symmetric 3×3 matrix.

use glam::{DMat3, DVec3};

/// Maximum number of sweeps; convergence is quadratic, and five suffice for any `f64` matrix.
const SWEEPS: usize = 12;

/// Off-diagonal elements below this share of the diagonal are rounding.
const ROUNDING: f64 = 1e-17;

/// Eigenvalues, and eigenvectors as columns of a proper rotation, a product of Jacobi rotations; also for equal, tiny
/// or zero eigenvalues.
pub(crate) fn eigen(symmetric: DMat3) -> (DVec3, DMat3) {
    let mut m = symmetric.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    for _ in 0..SWEEPS {
        let mut turned = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            turned |= turn(&mut m, &mut v, p, q);
        }
        if !turned {
            break;
        }
    }
    let values = DVec3::new(m[0][0], m[1][1], m[2][2]);
    (values, DMat3::from_cols_array_2d(&v))
}

/// Rotates in the plane of axes `p` and `q` until their off-diagonal element is zero; returns whether that was needed.
fn turn(m: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) -> bool {
    let across = m[p][q];
    if across.abs() <= ROUNDING * (m[p][p] * m[q][q]).abs().sqrt() || !across.is_normal() {
        return false;
    }
    // The smaller of the two possible angles.
    let half = 0.5 * (m[q][q] - m[p][p]) / across;
    let tangent = half.signum() / (half.abs() + half.hypot(1.0));
    let cosine = tangent.hypot(1.0).recip();
    let sine = tangent * cosine;
    let r = 3 - p - q;
    m[p][p] -= tangent * across;
    m[q][q] += tangent * across;
    let (with_p, with_q) = (m[r][p], m[r][q]);
    let turned = [
        (p, cosine * with_p - sine * with_q),
        (q, sine * with_p + cosine * with_q),
    ];
    for (axis, value) in turned {
        (m[r][axis], m[axis][r]) = (value, value);
    }
    (m[p][q], m[q][p]) = (0.0, 0.0);
    let (old_p, old_q) = (v[p], v[q]);
    for row in 0..3 {
        v[p][row] = cosine * old_p[row] - sine * old_q[row];
        v[q][row] = sine * old_p[row] + cosine * old_q[row];
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn check(variances: DVec3, rotation: DQuat) {
        let r = DMat3::from_quat(rotation);
        let m = r * DMat3::from_diagonal(variances) * r.transpose();
        let (values, v) = eigen(m);
        let largest = variances.max_element();
        let back = v * DMat3::from_diagonal(values) * v.transpose();
        let off = (back - m).to_cols_array().map(f64::abs);
        assert!(off.iter().all(|&x| x <= 1e-14 * largest), "{variances}: {off:?}");
        assert!((v.determinant() - 1.0).abs() < 1e-14, "{variances}: {v}");
        let mut found = values.to_array();
        let mut wanted = variances.to_array();
        found.sort_by(f64::total_cmp);
        wanted.sort_by(f64::total_cmp);
        for (a, b) in found.iter().zip(wanted) {
            assert!((a - b).abs() <= 1e-14 * largest, "{variances}: {values}");
        }
    }

    #[test]
    fn axes_are_a_proper_rotation_whatever_the_shape() {
        let shapes = [
            [1.0, 1.0, 1.0],
            [2.0, 2.0, 1e-3],
            [1e-12, 1e-12, 1.0],
            [1.0, 1.0, 0.0],
            [0.0, 0.0, 4.0],
            [0.0, 0.0, 0.0],
            [1e30, 1.0, 1e-30],
            [1e-60, 2e-60, 3e-60],
        ];
        for shape in shapes {
            for i in 0..50 {
                let t = f64::from(i);
                let axis = DVec3::new((1.3 * t).sin(), (2.1 * t).cos(), (0.7 * t).sin());
                let turn = DQuat::from_axis_angle(axis.normalize_or(DVec3::X), 0.37 * t);
                check(DVec3::from(shape), turn);
            }
        }
    }
}
