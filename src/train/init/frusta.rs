//! Random points in the cameras' frusta, for data sets without points.

use crate::scene::{Camera, Point, focus};
use crate::train::config::InitConfig;
use crate::train::rng::{self, Stream};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// `count` grey points inside the cameras' frusta, most of them in the view of many cameras. They lie around the point
/// that the cameras look at or, if their axes do not meet, within the scene extent.
///
/// Panics if there are no cameras.
pub fn points_in_frusta(cameras: &[Camera], count: usize, extent: f64, seed: u64, config: &InitConfig) -> Vec<Point> {
    assert!(!cameras.is_empty(), "points in frusta need a camera");
    let depths: Vec<f64> = match focus(cameras) {
        Some(focus) => cameras.iter().map(|c| c.position.distance(focus)).collect(),
        None => vec![extent; cameras.len()],
    };
    let step = cameras.len().div_ceil(config.random_cameras as usize);
    let voters: Vec<&Camera> = cameras.iter().step_by(step).collect();
    let point = |i: usize| {
        let (camera, depth) = (&cameras[i % cameras.len()], depths[i % cameras.len()]);
        let candidate = |draw: u32| {
            let position = draw_position(camera, depth, config.random_depths, [seed, i as u64, draw.into()]);
            let votes = voters.iter().filter(|c| c.sees(position)).count();
            (votes, position)
        };
        // The first of equals.
        let best = (1..config.random_candidates)
            .map(candidate)
            .fold(candidate(0), |best, next| if next.0 > best.0 { next } else { best });
        Point {
            position: best.1.to_array(),
            color: [0.5; 3],
        }
    };
    (0..count).into_par_iter().map(point).collect()
}

/// Uniform over the picture, and over depth.
fn draw_position(camera: &Camera, depth: f64, [near, far]: [f64; 2], [seed, index, draw]: [u64; 3]) -> DVec3 {
    let [u, v, w, _] = rng::uniform(seed, draw as u32, index as u32, Stream::RandomInit).map(f64::from);
    let pixel = DVec2::new(u * f64::from(camera.width), v * f64::from(camera.height));
    camera.position + camera.ray_from_pixel(pixel) * (depth * (near + (far - near) * w))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::test_camera;

    fn camera(position: DVec3, target: DVec3) -> Camera {
        test_camera(80, 60, 70.0).look_at(position, target, DVec3::Y)
    }

    fn ring(target: DVec3) -> Vec<Camera> {
        let at = |i: u32| {
            let angle = f64::from(i) * 0.7;
            camera(DVec3::new(angle.cos() * 4.0, 1.0, angle.sin() * 4.0), target)
        };
        (0..9).map(at).collect()
    }

    #[test]
    fn points_lie_where_many_cameras_look() {
        let cameras = ring(DVec3::ZERO);
        let points = points_in_frusta(&cameras, 500, 4.4, 1, &InitConfig::default());
        assert_eq!(points.len(), 500);
        assert_eq!(points, points_in_frusta(&cameras, 500, 4.4, 1, &InitConfig::default()));
        let votes = |p: &Point| {
            let position = DVec3::from(p.position);
            cameras.iter().filter(|c| c.sees(position)).count()
        };
        assert!(points.iter().all(|p| votes(p) > 0));
        let total: usize = points.iter().map(votes).sum();
        assert!(total > 500 * 4, "{total}");
    }

    #[test]
    fn a_lone_camera_uses_the_extent() {
        let one = [camera(DVec3::ZERO, DVec3::Z)];
        let points = points_in_frusta(&one, 100, 3.0, 1, &InitConfig::default());
        assert!(points.iter().all(|p| (0.59..=6.01).contains(&p.position[2])));
    }
}
