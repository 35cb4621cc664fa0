//! Axis systems of scene files, and turning splats from one to another.

use super::harmonics::ShRotation;
use super::{Splats, sh_coefficient_count};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use std::fmt;

/// Directions of x, y and z: right or left, up or down, front or back, each pair once.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Axes([char; 3]);

impl Axes {
    /// x right, y down, z front: COLMAP, 3DGS `.ply` files, this engine.
    pub const RDF: Axes = Axes(['R', 'D', 'F']);
    /// x right, y up, z back: OpenGL, three.js, the text of SPZ.
    pub const RUB: Axes = Axes(['R', 'U', 'B']);
    /// x left, y up, z front: glTF.
    pub const LUF: Axes = Axes(['L', 'U', 'F']);

    /// Axes of their three initials, such as `RUB`.
    pub fn parse(initials: &str) -> Option<Axes> {
        let letters: Vec<char> = initials.chars().collect();
        let axes = Axes(letters.try_into().ok()?);
        let matrix = axes.rdf_from_self()?;
        (matrix.determinant().abs() == 1.0).then_some(axes)
    }

    /// Matrix with these axes, in RDF, as columns; `None` for other letters.
    fn rdf_from_self(self) -> Option<DMat3> {
        let column = |letter| {
            Some(match letter {
                'R' => DVec3::X,
                'L' => -DVec3::X,
                'D' => DVec3::Y,
                'U' => -DVec3::Y,
                'F' => DVec3::Z,
                'B' => -DVec3::Z,
                _ => return None,
            })
        };
        let [x, y, z] = self.0;
        Some(DMat3::from_cols(column(x)?, column(y)?, column(z)?))
    }

    /// Matrix from these axes to others: a permutation with signs.
    pub fn to(self, other: Axes) -> DMat3 {
        // Only letters that `rdf_from_self` knows get into a value.
        let matrix = |axes: Axes| axes.rdf_from_self().unwrap_or(DMat3::IDENTITY);
        matrix(other).transpose() * matrix(self)
    }
}

impl Default for Axes {
    fn default() -> Axes {
        Axes::RDF
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0;
        write!(f, "{x}{y}{z}")
    }
}

impl fmt::Debug for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl Splats {
    /// Turns splats from one system of axes to another, harmonics and origin included. Changes signs only, and thus
    /// loses nothing, unless axes change places.
    pub fn change_axes(&mut self, from: Axes, to: Axes) {
        let mut matrix = from.to(to);
        let signs = |m: DMat3| [m.x_axis.x, m.y_axis.y, m.z_axis.z].map(|v| v as f32);
        if signs(matrix).iter().all(|&s| s != 0.0) {
            return self.mirror(signs(matrix));
        }
        if matrix.determinant() < 0.0 {
            self.mirror([-1.0, 1.0, 1.0]);
            matrix *= DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        }
        self.rotate(DQuat::from_mat3(&matrix));
    }

    /// Multiplies x, y and z of the world by `signs`, each 1 or −1.
    fn mirror(&mut self, signs: [f32; 3]) {
        let [x, y, z] = signs;
        if signs == [1.0; 3] {
            return;
        }
        let signs_f64 = DVec3::from(signs.map(f64::from));
        self.origin *= signs_f64;
        self.up = self.up.map(|up| up * signs_f64);
        for mean in &mut self.mean {
            *mean = [x * mean[0], y * mean[1], z * mean[2]];
        }
        for q in &mut self.quaternion {
            *q = [q[0], y * z * q[1], x * z * q[2], x * y * q[3]];
        }
        let parity = sh_signs(signs);
        let stride = self.sh_stride();
        for sh in self.sh.chunks_exact_mut(stride) {
            for (coefficient, sign) in sh.chunks_exact_mut(3).zip(parity) {
                coefficient.iter_mut().for_each(|value| *value *= sign);
            }
        }
    }

    /// Rotates the world about its origin.
    pub fn rotate(&mut self, rotation: DQuat) {
        let turned = |[x, y, z]: [f32; 3]| (rotation * DVec3::new(x.into(), y.into(), z.into())).as_vec3().into();
        self.origin = rotation * self.origin;
        self.up = self.up.map(|up| rotation * up);
        self.mean.par_iter_mut().for_each(|mean| *mean = turned(*mean));
        self.quaternion.par_iter_mut().for_each(|q| {
            let [w, x, y, z] = q.map(f64::from);
            let turned = rotation * DQuat::from_xyzw(x, y, z, w);
            *q = [turned.w, turned.x, turned.y, turned.z].map(|v| v as f32);
        });
        let harmonics = ShRotation::new(DMat3::from_quat(rotation), self.sh_degree);
        let stride = self.sh_stride();
        self.sh.par_chunks_exact_mut(stride).for_each(|sh| harmonics.apply(sh));
    }
}

/// Sign of every harmonic under a change of the signs of x, y and z, in file order. Each is a polynomial that is even
/// or odd in each of them.
pub(crate) fn sh_signs([x, y, z]: [f32; 3]) -> [f32; sh_coefficient_count(3)] {
    [1.0, y, z, x, x * y, y * z, 1.0, x * z, 1.0, y, x * y * z, y, z, x, z, x]
}

#[cfg(test)]
mod tests {
    use super::super::sh_basis;
    use super::*;

    const ALL: [&str; 16] = [
        "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF", "LFD", "RFD", "LFU", "RFU", "LBD", "RBD", "LBU", "RBU",
    ];

    fn splat() -> Splats {
        Splats {
            mean: vec![[1.0, 2.0, 3.0]],
            quaternion: vec![[0.8, 0.36, -0.48, 0.0]],
            log_scale: vec![[-1.0, 0.0, 0.5]],
            opacity_logit: vec![0.0],
            sh: (0..48).map(|i| (i as f32 * 0.7).sin()).collect(),
            sh_degree: 3,
            origin: DVec3::new(10.0, 20.0, 30.0),
            up: Some(DVec3::new(0.0, -0.8, 0.6)),
            ..Splats::default()
        }
    }

    fn covariance(splats: &Splats) -> DMat3 {
        let [w, x, y, z] = splats.quaternion[0].map(f64::from);
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let scale = DVec3::from(splats.log_scale[0].map(|s| f64::from(s).exp()));
        rotation * DMat3::from_diagonal(scale * scale) * rotation.transpose()
    }

    fn color(splats: &Splats, direction: DVec3) -> f64 {
        let basis = sh_basis(direction.into());
        let red = splats.sh.iter().step_by(3);
        red.zip(basis).map(|(c, b)| f64::from(*c) * b).sum()
    }

    #[test]
    fn splats_look_the_same_from_every_side_in_all_axes() {
        for name in ALL {
            let axes = Axes::parse(name).unwrap();
            assert_eq!(axes.to_string(), name);
            let (before, mut after) = (splat(), splat());
            after.change_axes(Axes::RDF, axes);
            let m = Axes::RDF.to(axes);
            let off = m * covariance(&before) * m.transpose() - covariance(&after);
            assert!(off.to_cols_array().iter().all(|v| v.abs() < 1e-6), "{name}: {off}");
            let mean = |s: &Splats| DVec3::from(s.mean[0].map(f64::from));
            assert!((m * mean(&before) - mean(&after)).length() < 1e-6, "{name}");
            assert!((m * before.origin - after.origin).length() < 1e-6, "{name}");
            let up = |s: &Splats| s.up.unwrap();
            assert!((m * up(&before) - up(&after)).length() < 1e-12, "{name}");
            for i in 0..20 {
                let t = f64::from(i);
                let d = DVec3::new((1.3 * t).sin(), (2.1 * t).cos(), (0.7 * t).sin()).normalize();
                let (a, b) = (color(&before, d), color(&after, m * d));
                assert!((a - b).abs() < 1e-5, "{name}: {a}, {b}");
            }
            after.change_axes(axes, Axes::RDF);
            let worst = after.sh.iter().zip(&before.sh).map(|(a, b)| (a - b).abs());
            assert!(worst.fold(0.0, f32::max) < 1e-6, "{name}");
        }
    }

    #[test]
    fn axes_need_one_letter_of_each_pair() {
        for wrong in ["", "RD", "RDFB", "RRF", "RLF", "XYZ", "rdf"] {
            assert_eq!(Axes::parse(wrong), None, "{wrong}");
        }
    }
}
