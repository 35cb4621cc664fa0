//! Axes of a camera's motion, and the step along each.
//!
//! A turn to the side and a shift to the side move a picture nearly alike. Where steps are taken along turns and shifts
//! themselves, the picture is soon in place and their difference, which only parallax shows, remains. So the axes are
//! those of the mean squared motion of the points' pixels, J of each point by the six numbers of the pose: eigenvectors
//! of Σ Jᵀ J, with its roots as pixels per unit.

use crate::scene::Camera;
use glam::DVec3;

/// Turn about the camera's axes in radians, and shift along them in scene extents.
pub(super) type Motion = [f64; 6];

/// Most points of a camera.
const POINTS_MAX: usize = 2_000;

/// Axes of motion of one photograph, orthonormal, and the pixels that a unit along each moves the points (rms).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MotionModes {
    pub(super) axes: [Motion; 6],
    pub(super) pixels: [f64; 6],
}

impl MotionModes {
    /// Modes of a camera that sees some points of the world; those outside its picture do not count.
    pub(super) fn of(camera: &Camera, extent: f64, points: impl Iterator<Item = DVec3>) -> MotionModes {
        let mut moments = [[0.0; 6]; 6];
        let mut count = 0;
        for point in points.filter(|point| camera.sees(*point)).take(POINTS_MAX) {
            for row in rows(camera, extent, camera.view_from_world(point)) {
                for (line, a) in moments.iter_mut().zip(row) {
                    let terms = line.iter_mut().zip(row);
                    terms.for_each(|(sum, b)| *sum += a * b);
                }
            }
            count += 1;
        }
        moments
            .as_flattened_mut()
            .iter_mut()
            .for_each(|m| *m /= f64::from(count.max(1)));
        let (values, axes) = eigen(moments);
        MotionModes {
            axes,
            pixels: values.map(|value| value.max(0.0).sqrt()),
        }
    }

    /// Components along the axes.
    pub(super) fn along(&self, motion: &Motion) -> Motion {
        self.axes.map(|axis| axis.iter().zip(motion).map(|(a, b)| a * b).sum())
    }

    /// Motion of these components.
    pub(super) fn motion(&self, components: &Motion) -> Motion {
        let mut motion = [0.0; 6];
        for (axis, component) in self.axes.iter().zip(components) {
            let terms = motion.iter_mut().zip(axis);
            terms.for_each(|(sum, a)| *sum += component * a);
        }
        motion
    }
}

/// Derivatives of the pixel of a point at `at` in the view by the motion of the camera.
fn rows(camera: &Camera, extent: f64, at: DVec3) -> [Motion; 2] {
    let (x, y, z) = (at.x, at.y, at.z);
    let along = |row: DVec3| {
        // The camera's turn w moves the view's point by w × p, its shift s by -s.
        let turn = at.cross(row);
        let shift = -extent * row;
        [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
    };
    [
        along(DVec3::new(1.0, 0.0, -x / z) * (camera.focal.x / z)),
        along(DVec3::new(0.0, 1.0, -y / z) * (camera.focal.y / z)),
    ]
}

/// Eigenvalues and eigenvectors of a symmetric matrix, by Jacobi rotations.
fn eigen(mut m: [[f64; 6]; 6]) -> ([f64; 6], [Motion; 6]) {
    let mut axes: [Motion; 6] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for _ in 0..30 {
        let mut is_diagonal = true;
        for (p, q) in (0..6).flat_map(|p| (p + 1..6).map(move |q| (p, q))) {
            if m[p][q].abs() <= 1e-15 * (m[p][p] * m[q][q]).abs().sqrt() {
                continue;
            }
            is_diagonal = false;
            let half = 0.5 * (m[q][q] - m[p][p]) / m[p][q];
            let tangent = half.signum() / (half.abs() + half.hypot(1.0));
            let cosine = tangent.hypot(1.0).recip();
            turn(&mut m, &mut axes, [p, q], [cosine, tangent * cosine]);
        }
        if is_diagonal {
            break;
        }
    }
    (std::array::from_fn(|i| m[i][i]), axes)
}

/// Rotates rows and columns `p` and `q`, and the axes.
fn turn(m: &mut [[f64; 6]; 6], axes: &mut [Motion; 6], [p, q]: [usize; 2], [cosine, sine]: [f64; 2]) {
    let mix = |a: f64, b: f64| (cosine * a - sine * b, sine * a + cosine * b);
    for row in m.iter_mut() {
        (row[p], row[q]) = mix(row[p], row[q]);
    }
    for k in 0..6 {
        (m[p][k], m[q][k]) = mix(m[p][k], m[q][k]);
        (axes[p][k], axes[q][k]) = mix(axes[p][k], axes[q][k]);
    }
    (m[p][q], m[q][p]) = (0.0, 0.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::test_camera;

    fn points() -> impl Iterator<Item = DVec3> + Clone {
        let place = |i: u32| f64::from(i % 100) / 50.0 - 1.0;
        (0..400).map(move |i| DVec3::new(place(i), place(7 * i + 3), 4.0 + 0.5 * place(13 * i)))
    }

    #[test]
    fn modes_are_orthogonal_and_tell_how_far_pixels_move() {
        let camera = test_camera(160, 120, 170.0);
        let extent = 5.0;
        let modes = MotionModes::of(&camera, extent, points());
        for (i, a) in modes.axes.iter().enumerate() {
            for (j, b) in modes.axes.iter().enumerate() {
                let product: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                assert!((product - f64::from(u8::from(i == j))).abs() < 1e-12, "{i} {j}");
            }
        }
        // The camera moves a little along each, and the pixels with it.
        for (axis, pixels) in modes.axes.iter().zip(modes.pixels) {
            let step = 1e-6;
            let [x, y, z, right, down, ahead] = axis.map(|a| a * step);
            let moved = Camera {
                rotation: glam::DMat3::from_quat(glam::DQuat::from_scaled_axis(DVec3::new(x, y, z))),
                position: extent * DVec3::new(right, down, ahead),
                ..camera
            };
            let (mut sum, mut count) = (0.0_f64, 0.0);
            for point in points().filter(|point| camera.sees(*point)) {
                let [old, new] = [camera, moved].map(|camera| camera.pixel_from_world(point).unwrap_or_default());
                sum += (new - old).length_squared() / (step * step);
                count += 1.0;
            }
            assert!(((sum / count).sqrt() / pixels - 1.0).abs() < 1e-3, "{pixels}");
        }
        let motion = [0.1, -0.2, 0.3, 0.5, 0.0, 1.0];
        let again = modes.motion(&modes.along(&motion));
        assert!(motion.iter().zip(again).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn without_points_axes_are_turns_and_shifts() {
        let modes = MotionModes::of(&test_camera(16, 12, 17.0), 1.0, std::iter::empty());
        assert_eq!(modes.pixels, [0.0; 6]);
        assert_eq!(modes.axes[4], [0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    }
}
