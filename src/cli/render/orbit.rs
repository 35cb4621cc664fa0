//! Cameras on a path around a scene.

use crate::scene::{Camera, Splats, focus, mean_up};
use crate::stats::quantile;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_3, TAU};

/// `count` cameras around the focus of `cameras`, at their mean height and distance, with the first one's intrinsics.
/// The path is a full circle if the cameras surround their subject, else a swing to and fro over their arc. `extent` is
/// the scene extent.
///
/// Panics if there are no cameras.
pub(crate) fn orbit_of_cameras(cameras: &[Camera], extent: f64, count: u32) -> Vec<Camera> {
    assert!(!cameras.is_empty(), "an orbit needs a camera to go by");
    let mean = |of: fn(&Camera) -> DVec3| cameras.iter().map(of).sum::<DVec3>() / cameras.len() as f64;
    let position = mean(|c| c.position);
    let forward = mean(|c| c.rotation.row(2));
    let up = mean_up(cameras).unwrap_or(DVec3::NEG_Y);
    // Without a focus (parallel or diverging views) the target is a point ahead of the cameras.
    let ahead = forward.try_normalize().unwrap_or(DVec3::Z) * extent;
    let target = focus(cameras).unwrap_or(position + ahead);
    let frame = CylinderFrame::new(target, up, position);
    let polar: Vec<[f64; 3]> = cameras.iter().map(|c| frame.polar(c.position)).collect();
    let average = |axis: usize| polar.iter().map(|p| p[axis]).sum::<f64>() / polar.len() as f64;
    let arc = Arc::of(polar.iter().map(|p| p[0]).collect());
    let at = |i: u32| {
        let angle = arc.at(f64::from(i) / f64::from(count));
        let place = frame.place(angle, average(1), average(2));
        cameras[0].look_at(place, target, up)
    };
    (0..count).map(at).collect()
}

/// `count` cameras around splats, upright by the scene's upward direction, without one y down as in most captures.
pub(in crate::cli) fn orbit_of_splats(splats: &Splats, count: Option<u32>) -> Vec<Camera> {
    let (count, target) = (count.unwrap_or(1), center(splats));
    let camera = around(target);
    let distance = 2.5 * radius(splats);
    let up = splats.up.and_then(DVec3::try_normalize).unwrap_or(DVec3::NEG_Y);
    let frame = CylinderFrame::new(target, up, target - DVec3::Z);
    let at = |i: u32| {
        let angle = TAU * f64::from(i) / f64::from(count);
        let place = frame.place(angle, 0.94 * distance, 0.34 * distance);
        camera.look_at(place, target, up)
    };
    (0..count).map(at).collect()
}

/// `count` cameras on a sphere around splats, evenly spread.
pub(in crate::cli) fn sphere_of_splats(splats: &Splats, count: u32) -> Vec<Camera> {
    let target = center(splats);
    let distance = 2.5 * radius(splats);
    // A spiral of golden angles.
    let at = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let (sine, cosine) = (f64::from(i) * TAU / 1.618_033_988_749_895).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let place = target + distance * DVec3::new(r * cosine, z, r * sine);
        around(target).look_at(place, target, DVec3::NEG_Y)
    };
    (0..count).map(at).collect()
}

/// Camera of pictures around splats.
fn around(position: DVec3) -> Camera {
    Camera {
        width: 960,
        height: 720,
        focal: DVec2::splat(960.0),
        center: DVec2::new(480.0, 360.0),
        rotation: DMat3::IDENTITY,
        position,
    }
}

/// Median position, robust against outliers.
pub(in crate::cli) fn center(splats: &Splats) -> DVec3 {
    let axis = |axis: usize| finite_quantile(splats.mean.iter().map(|m| f64::from(m[axis])), 0.5);
    DVec3::new(axis(0), axis(1), axis(2))
}

/// Radius around the median that holds 80 % of the splats; 1 if that is 0.
pub(in crate::cli) fn radius(splats: &Splats) -> f64 {
    let center = center(splats);
    let distances = splats
        .mean
        .iter()
        .map(|&m| DVec3::from(m.map(f64::from)).distance(center));
    let radius = finite_quantile(distances, 0.8);
    if radius > 0.0 { radius } else { 1.0 }
}

/// Quantile of the finite values; 0 if there are none.
fn finite_quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    quantile(&mut values, share).unwrap_or(0.0)
}

/// Cylinder coordinates around a target.
struct CylinderFrame {
    target: DVec3,
    up: DVec3,
    /// Direction of angle 0, and of a quarter turn.
    axes: [DVec3; 2],
}

impl CylinderFrame {
    /// Angle 0 lies on the side of `start`.
    fn new(target: DVec3, up: DVec3, start: DVec3) -> CylinderFrame {
        let flat = (start - target).reject_from_normalized(up);
        let zero = flat.try_normalize().unwrap_or(up.any_orthonormal_vector());
        CylinderFrame {
            target,
            up,
            axes: [zero, up.cross(zero)],
        }
    }

    /// Angle, distance from the axis, height.
    fn polar(&self, point: DVec3) -> [f64; 3] {
        let offset = point - self.target;
        let [x, y] = self.axes.map(|axis| offset.dot(axis));
        [y.atan2(x), x.hypot(y), offset.dot(self.up)]
    }

    fn place(&self, angle: f64, distance: f64, height: f64) -> DVec3 {
        let (sin, cos) = angle.sin_cos();
        self.target + (self.axes[0] * cos + self.axes[1] * sin) * distance + self.up * height
    }
}

/// Arc of the cameras' angles.
struct Arc {
    start: f64,
    length: f64,
}

impl Arc {
    fn of(mut angles: Vec<f64>) -> Arc {
        angles.sort_unstable_by(f64::total_cmp);
        let around = angles.iter().skip(1).chain(angles.first());
        let gaps = angles.iter().zip(around).map(|(a, b)| ((b - a).rem_euclid(TAU), *b));
        let widest = gaps.fold((0.0, 0.0), |best, gap| if gap.0 > best.0 { gap } else { best });
        // One camera, or all in one place: the gap is the whole circle.
        let gap = if angles.len() < 2 { TAU } else { widest.0 };
        match gap < FRAC_PI_3 {
            true => Arc {
                start: 0.0,
                length: TAU,
            },
            false => Arc {
                start: widest.1,
                // A minimal swing, so that the orbit shows motion.
                length: (TAU - gap).max(0.2),
            },
        }
    }

    /// Angle at `share` of the closed path.
    fn at(&self, share: f64) -> f64 {
        if self.length == TAU {
            return share * TAU;
        }
        self.start + self.length * (0.5 - 0.5 * (share * TAU).cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(angle: f64) -> Camera {
        let place = DVec3::new(angle.cos() * 3.0, -1.0, angle.sin() * 3.0) + DVec3::X;
        let camera = Camera {
            width: 64,
            height: 48,
            focal: DVec2::splat(50.0),
            center: DVec2::new(32.0, 24.0),
            rotation: DMat3::IDENTITY,
            position: place,
        };
        camera.look_at(place, DVec3::X, DVec3::NEG_Y)
    }

    fn angles(cameras: &[Camera]) -> Vec<f64> {
        let angle = |c: &Camera| (c.position.z).atan2(c.position.x - 1.0);
        cameras.iter().map(angle).collect()
    }

    #[test]
    fn a_surrounded_subject_is_circled_at_the_cameras_height() {
        let ring: Vec<Camera> = (0..20).map(|i| camera(f64::from(i) * TAU / 20.0)).collect();
        let orbit = orbit_of_cameras(&ring, 3.3, 8);
        for camera in &orbit {
            assert!((camera.position - DVec3::X).reject_from(DVec3::Y).length() - 3.0 < 1e-9);
            assert!((camera.position.y + 1.0).abs() < 1e-9);
            let pixel = camera.pixel_from_world(DVec3::X);
            assert!(pixel.is_some_and(|p| p.distance(DVec2::new(32.0, 24.0)) < 1e-9));
        }
        let mut sides = angles(&orbit);
        sides.sort_unstable_by(f64::total_cmp);
        assert!(sides.windows(2).all(|w| (w[1] - w[0] - TAU / 8.0).abs() < 1e-6));
    }

    #[test]
    fn a_frontal_capture_is_swung_over() {
        let front: Vec<Camera> = (0..=10).map(|i| camera(f64::from(i) * 0.1)).collect();
        let orbit = orbit_of_cameras(&front, 1.0, 40);
        for angle in angles(&orbit) {
            assert!((-1e-6..=1.0 + 1e-6).contains(&angle), "{angle}");
        }
        let single = orbit_of_cameras(&front[..1], 1.0, 4);
        assert!(single.iter().all(|c| c.position.is_finite()));
    }

    #[test]
    fn splats_of_any_number_can_be_circled() {
        let mut splats = Splats::default();
        assert_eq!(radius(&splats), 1.0);
        splats.mean = vec![[1.0; 3], [3.0; 3], [2.0; 3], [1e9; 3], [f32::NAN; 3]];
        let orbit = orbit_of_splats(&splats, Some(3));
        assert_eq!(orbit.len(), 3);
        assert!(
            orbit
                .iter()
                .all(|c| c.position.is_finite() && c.position.length() < 20.0)
        );
    }

    #[test]
    fn the_circle_stands_upright_by_the_scene() {
        let mut splats = Splats {
            mean: vec![[1.0; 3], [3.0; 3], [2.0; 3]],
            ..Splats::default()
        };
        let upright = |splats: &Splats, up: DVec3| {
            let orbit = orbit_of_splats(splats, Some(5));
            let heights: Vec<f64> = orbit.iter().map(|c| up.dot(c.position - DVec3::splat(2.0))).collect();
            let level = heights.iter().all(|h| (h - heights[0]).abs() < 1e-9);
            // Horizontal axes of all cameras are level, and their vertical ones point up.
            let stands = |c: &Camera| up.dot(c.rotation.row(0)).abs() < 1e-9 && up.dot(c.rotation.row(1)) < -0.5;
            level && heights[0] > 0.1 && orbit.iter().all(stands)
        };
        assert!(upright(&splats, DVec3::NEG_Y));
        for up in [DVec3::new(0.2, -0.5, 0.6), DVec3::NEG_Z, DVec3::Z] {
            splats.up = Some(2.0 * up);
            assert!(upright(&splats, up.normalize()), "{up}");
        }
    }
}
