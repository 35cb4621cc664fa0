//! Focus of a set of cameras, and their upward direction.

use super::Camera;
use glam::{DMat3, DVec3};

/// The point nearest to all optical axes (least squares). `None` if the axes are nearly parallel, or if it would lie
/// behind half of the cameras, as when they look outward.
pub fn focus(cameras: &[Camera]) -> Option<DVec3> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let axis = camera.rotation.row(2);
        let along = DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += DMat3::IDENTITY - along;
        right += (DMat3::IDENTITY - along) * camera.position;
    }
    // For cameras with one direction the mean matrix is a projection, with determinant 0; 1e-4 needs about half a
    // degree between the axes.
    let mean = normal * (1.0 / cameras.len().max(1) as f64);
    if mean.determinant() < 1e-4 {
        return None;
    }
    let focus = normal.inverse() * right;
    let ahead = cameras.iter().filter(|c| c.view_from_world(focus).z > 0.0);
    (focus.is_finite() && ahead.count() * 2 > cameras.len()).then_some(focus)
}

/// Mean upward direction of cameras in the world, of unit length; `None` without cameras, or if their directions cancel
/// out.
pub fn mean_up(cameras: &[Camera]) -> Option<DVec3> {
    let sum: DVec3 = cameras.iter().map(|c| -c.rotation.row(1)).sum();
    // Rounding leaves a little of directions that cancel out.
    let is_clear = sum.length() > 1e-6 * cameras.len() as f64;
    sum.try_normalize().filter(|_| is_clear)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    fn camera(position: DVec3, target: DVec3) -> Camera {
        let camera = Camera {
            width: 80,
            height: 60,
            focal: DVec2::splat(70.0),
            center: DVec2::new(40.0, 30.0),
            rotation: DMat3::IDENTITY,
            position,
        };
        camera.look_at(position, target, DVec3::Y)
    }

    #[test]
    fn axes_that_meet_have_a_focus_and_others_none() {
        let target = DVec3::new(0.3, -2.0, 1.0);
        let place = |i: u32| DVec3::new(f64::from(i).cos() * 4.0, 1.0, f64::from(i).sin() * 4.0);
        let inward: Vec<Camera> = (0..9).map(|i| camera(place(i), target)).collect();
        assert!(focus(&inward).is_some_and(|f| f.distance(target) < 1e-9));
        let outward: Vec<Camera> = (0..9).map(|i| camera(place(i), place(i) * 2.0)).collect();
        assert_eq!(focus(&outward), None);
        assert_eq!(focus(&inward[..1]), None);
        assert_eq!(focus(&[]), None);
    }

    #[test]
    fn the_upward_direction_is_that_of_the_cameras() {
        let eye = DVec3::new(0.0, 3.0, -4.0);
        let level: Vec<Camera> = (0..6)
            .map(|i| {
                let angle = f64::from(i) * std::f64::consts::FRAC_PI_3;
                camera(DVec3::new(5.0 * angle.cos(), 2.0, 5.0 * angle.sin()), DVec3::ZERO)
            })
            .collect();
        // A ring that looks down a little: single directions lean, their mean is upright.
        assert!(mean_up(&level).is_some_and(|up| up.distance(DVec3::Y) < 1e-12));
        assert!(mean_up(&level[..1]).is_some_and(|up| up.distance(DVec3::Y) > 0.1));
        let above = camera(eye, DVec3::ZERO);
        let below = Camera {
            rotation: DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)) * above.rotation,
            ..above
        };
        assert_eq!(mean_up(&[above, below]), None);
        assert_eq!(mean_up(&[]), None);
    }
}
