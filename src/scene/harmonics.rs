//! Real spherical harmonics up to degree 3, in the order and with the signs of 3DGS files, and their rotation.

use glam::{DMat3, DVec3};

/// √(1 / 4π).
const C0: f64 = 0.282_094_791_773_878_14;
/// √(3 / 4π).
const C1: f64 = 0.488_602_511_902_919_9;
/// √(15 / 4π), √(5 / 16π), √(15 / 16π).
const C2: [f64; 3] = [
    1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    0.546_274_215_296_039_6,
];
/// √(35 / 32π), √(105 / 4π), √(21 / 32π), √(7 / 16π), √(105 / 16π).
const C3: [f64; 5] = [
    0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    1.445_305_721_320_277,
];

/// All 16 functions at a unit vector.
pub fn sh_basis([x, y, z]: [f64; 3]) -> [f64; 16] {
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        -C2[0] * y * z,
        C2[1] * (2.0 * zz - xx - yy),
        -C2[0] * x * z,
        C2[2] * (xx - yy),
        -C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        -C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -C3[2] * x * (4.0 * zz - xx - yy),
        C3[4] * z * (xx - yy),
        -C3[0] * x * (xx - 3.0 * yy),
    ]
}

/// Rotation of the coefficients of a function on the sphere: f′(R d) = f(d).
///
/// A rotated function of degree l is one of degree l. Its values at 2 l + 1 directions determine it.
pub(crate) struct ShRotation {
    /// Matrices of degrees 1 and up, by rows.
    bands: Vec<Vec<f64>>,
}

impl ShRotation {
    /// Rotation by an orthogonal matrix.
    pub(crate) fn new(rotation: DMat3, degree: u32) -> ShRotation {
        let bands = (1..=degree as usize).map(|l| band(rotation, l)).collect();
        ShRotation { bands }
    }

    /// Rotates the coefficients `[coefficient][rgb]` of a splat.
    pub(crate) fn apply(&self, sh: &mut [f32]) {
        for (l, matrix) in (1..).zip(&self.bands) {
            let size = 2 * l + 1;
            let of_band = &mut sh[3 * l * l..3 * (l + 1) * (l + 1)];
            let before: Vec<f64> = of_band.iter().map(|&v| v.into()).collect();
            for (row, coefficient) in matrix.chunks_exact(size).zip(of_band.chunks_exact_mut(3)) {
                for (channel, value) in coefficient.iter_mut().enumerate() {
                    let column = before.iter().skip(channel).step_by(3);
                    *value = row.iter().zip(column).map(|(m, b)| m * b).sum::<f64>() as f32;
                }
            }
        }
    }
}

/// Matrix of degree `l`: Y⁻¹ Y(R⁻¹ d) of the functions at 2 l + 1 directions d.
fn band(rotation: DMat3, l: usize) -> Vec<f64> {
    let size = 2 * l + 1;
    let values = |d: DVec3| sh_basis(d.into())[l * l..(l + 1) * (l + 1)].to_vec();
    // Rows [Y(d) | Y(R⁻¹ d)] at directions of a sequence without symmetry, reduced to [1 | matrix].
    let mut rows: Vec<Vec<f64>> = (0..size)
        .map(|i| {
            let z = 2.0 * (0.5 + 0.754_877_666 * i as f64).fract() - 1.0;
            let (sine, cosine) = (3.580_187 * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let d = DVec3::new(r * cosine, r * sine, z);
            [values(d), values(rotation.transpose() * d)].concat()
        })
        .collect();
    for column in 0..size {
        let pivot = (column..size).max_by(|&a, &b| rows[a][column].abs().total_cmp(&rows[b][column].abs()));
        rows.swap(column, pivot.unwrap_or(column));
        let scale = rows[column][column].recip();
        rows[column].iter_mut().for_each(|v| *v *= scale);
        let by = rows[column].clone();
        for row in rows
            .iter_mut()
            .enumerate()
            .filter_map(|(i, row)| (i != column).then_some(row))
        {
            let factor = row[column];
            row.iter_mut().zip(&by).for_each(|(v, b)| *v -= factor * b);
        }
    }
    rows.iter().flat_map(|row| row[size..].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Addition theorem; `tests/device/simplify/colors.rs` compares order and signs with the reference.
    #[test]
    fn squares_of_a_degree_sum_to_the_same_everywhere() {
        for i in 0..50 {
            let angle = f64::from(i) * 2.4;
            let z = f64::from(i) / 25.0 - 0.98;
            let r = (1.0 - z * z).sqrt();
            let values = sh_basis([r * angle.cos(), r * angle.sin(), z]);
            for degree in 0..4_usize {
                let band = &values[degree * degree..(degree + 1) * (degree + 1)];
                let squares: f64 = band.iter().map(|value| value * value).sum();
                let wanted = (2 * degree + 1) as f64 / (4.0 * std::f64::consts::PI);
                assert!((squares - wanted).abs() < 1e-12, "degree {degree}: {squares}");
            }
        }
    }
}
