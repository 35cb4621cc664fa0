//! Differences of two sets of poses of the same photographs, and the similarity of the world between them.

use super::{Camera, Similarity};
use glam::{DMat3, DQuat, DVec3};

/// Rounds of rotation and scale in turn; each of them gains digits, for the scale is near that of the centres alone.
const ROUNDS: usize = 50;

impl Similarity {
    /// The similarity that brings the cameras `from` nearest to the cameras `to`, pair by pair: least squares of the
    /// distances of centres in units of the spread of `from`, and of the chords of rotations. Rotations take part, so
    /// that centres on a line, or in one place, are enough. The identity without cameras.
    pub fn between(from: &[Camera], to: &[Camera]) -> Similarity {
        assert_eq!(from.len(), to.len(), "cameras come in pairs");
        if from.is_empty() {
            return Similarity::IDENTITY;
        }
        let mean = |cameras: &[Camera]| cameras.iter().map(|c| c.position).sum::<DVec3>() / cameras.len() as f64;
        let (origin, target) = (mean(from), mean(to));
        let (mut spread, mut across, mut turns) = (0.0, DMat3::ZERO, DMat3::ZERO);
        for (a, b) in from.iter().zip(to) {
            let (old, new) = (a.position - origin, b.position - target);
            spread += old.length_squared();
            across += outer(new, old);
            turns += b.rotation.transpose() * a.rotation;
        }
        // Equal centres leave rounding.
        let has_spread = spread > 1e-18 * (1.0 + origin.length_squared()) * from.len() as f64;
        let weight = if has_spread { from.len() as f64 / spread } else { 0.0 };
        let mut found = Similarity::IDENTITY;
        for _ in 0..ROUNDS {
            found.rotation = nearest_rotation(across * (weight * found.scale) + turns).unwrap_or(found.rotation);
            if has_spread {
                let along = trace(found.rotation.transpose() * across);
                found.scale = (along / spread).max(1e-6);
            }
        }
        found.translation = target - found.scale * (found.rotation * origin);
        found
    }

    /// The opposite map.
    pub fn inverse(&self) -> Similarity {
        let rotation = self.rotation.transpose();
        Similarity {
            rotation,
            scale: 1.0 / self.scale,
            translation: -(rotation * self.translation) / self.scale,
        }
    }

    /// The camera that sees the moved world as `camera` sees the world.
    pub fn moved(&self, camera: &Camera) -> Camera {
        Camera {
            rotation: camera.rotation * self.rotation.transpose(),
            position: self.scale * (self.rotation * camera.position) + self.translation,
            ..*camera
        }
    }

    /// Angle of the rotation, degrees.
    pub fn degrees(&self) -> f64 {
        turn_degrees(&self.rotation)
    }
}

/// Differences of the poses of two cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseDifference {
    /// Angle between the orientations, degrees.
    pub degrees: f64,
    /// Distance of the centres, world units.
    pub distance: f64,
    /// Turn from the first to the second, a vector of degrees in the axes of the first camera.
    pub turn: DVec3,
    /// Shift from the first to the second, world units along the axes of the first camera.
    pub shift: DVec3,
}

impl PoseDifference {
    /// Difference of two cameras.
    pub fn of(a: &Camera, b: &Camera) -> PoseDifference {
        let relative = b.rotation * a.rotation.transpose();
        PoseDifference {
            degrees: turn_degrees(&relative),
            distance: a.position.distance(b.position),
            turn: DQuat::from_mat3(&relative).to_scaled_axis() * 1_f64.to_degrees(),
            shift: a.rotation * (b.position - a.position),
        }
    }

    /// Root mean squares of angles and distances.
    pub fn rms(all: &[PoseDifference]) -> PoseDifference {
        let rms = |of: fn(&PoseDifference) -> f64| {
            let squares: f64 = all.iter().map(|difference| of(difference).powi(2)).sum();
            (squares / all.len().max(1) as f64).sqrt()
        };
        PoseDifference {
            degrees: rms(|of| of.degrees),
            distance: rms(|of| of.distance),
            ..PoseDifference::default()
        }
    }
}

/// Angle of a rotation in degrees; exact for small angles, where the cosine is not.
fn turn_degrees(rotation: &DMat3) -> f64 {
    let [x, y, z] = [rotation.x_axis, rotation.y_axis, rotation.z_axis];
    let axis = DVec3::new(y.z - z.y, z.x - x.z, x.y - y.x);
    (0.5 * axis.length()).atan2(0.5 * (trace(*rotation) - 1.0)).to_degrees()
}

fn trace(m: DMat3) -> f64 {
    m.x_axis.x + m.y_axis.y + m.z_axis.z
}

/// `a bᵀ`.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The proper rotation nearest to a matrix, its polar factor, by Newton's iteration; `None` without one that is near.
fn nearest_rotation(matrix: DMat3) -> Option<DMat3> {
    let mut near = matrix;
    for _ in 0..60 {
        if near.determinant() <= 0.0 || !near.is_finite() {
            return None;
        }
        let next = (near + near.inverse().transpose()) * 0.5;
        if next == near {
            break;
        }
        near = next;
    }
    near.is_finite().then_some(near)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    fn cameras(position: impl Fn(f64) -> DVec3) -> Vec<Camera> {
        let camera = |i: u32| Camera {
            width: 40,
            height: 30,
            focal: DVec2::splat(35.0),
            center: DVec2::new(20.0, 15.0),
            rotation: DMat3::from_quat(DQuat::from_euler(
                glam::EulerRot::XYZ,
                0.3 * f64::from(i),
                0.1,
                f64::from(i),
            )),
            position: position(f64::from(i)),
        };
        (0..9).map(camera).collect()
    }

    fn similarity() -> Similarity {
        Similarity {
            rotation: DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 2.0)),
            scale: 3.0,
            translation: DVec3::new(5.0, -2.0, 1.0),
        }
    }

    fn assert_same(a: &Similarity, b: &Similarity) {
        let rotation = (a.rotation - b.rotation).to_cols_array();
        assert!(rotation.iter().all(|d| d.abs() < 1e-9), "{a:?} {b:?}");
        assert!((a.scale - b.scale).abs() < 1e-9 && a.translation.distance(b.translation) < 1e-8);
    }

    #[test]
    fn a_similarity_is_found_again() {
        let wanted = similarity();
        let around = |i: f64| DVec3::new(i.cos(), i.sin(), 0.1 * i);
        let line = |i: f64| DVec3::new(0.0, i, 4.0);
        for from in [cameras(around), cameras(line)] {
            let to: Vec<Camera> = from.iter().map(|camera| wanted.moved(camera)).collect();
            assert_same(&Similarity::between(&from, &to), &wanted);
            assert_same(&Similarity::between(&to, &from), &wanted.inverse());
        }
        // One place: its scale is not told.
        let from = cameras(|_| DVec3::ONE);
        let to: Vec<Camera> = from.iter().map(|camera| wanted.moved(camera)).collect();
        let found = Similarity::between(&from, &to);
        assert_eq!(found.scale, 1.0);
        assert!(
            (found.rotation - wanted.rotation)
                .to_cols_array()
                .iter()
                .all(|d| d.abs() < 1e-9)
        );
        assert_eq!(Similarity::between(&[], &[]), Similarity::IDENTITY);
    }

    #[test]
    fn moved_cameras_see_the_moved_world() {
        let (wanted, point) = (similarity(), DVec3::new(0.2, 0.3, 0.4));
        let moved = wanted.scale * (wanted.rotation * point) + wanted.translation;
        for camera in cameras(|i| DVec3::new(i, 1.0, -2.0)) {
            let (old, new) = (
                camera.view_from_world(point),
                wanted.moved(&camera).view_from_world(moved),
            );
            assert!((old * wanted.scale).distance(new) < 1e-12);
        }
    }

    #[test]
    fn differences_are_angles_and_distances() {
        let [a, ..] = cameras(|_| DVec3::ZERO)[..] else { return };
        for degrees in [1e-9, 0.5, 90.0, 179.0_f64] {
            let turn = DMat3::from_axis_angle(DVec3::Y, degrees.to_radians());
            let b = Camera {
                rotation: a.rotation * turn,
                position: DVec3::new(0.0, 3.0, 4.0),
                ..a
            };
            let found = PoseDifference::of(&a, &b);
            assert!(
                (found.degrees / degrees - 1.0).abs() < 1e-6 && found.distance == 5.0,
                "{found:?}"
            );
        }
    }
}
