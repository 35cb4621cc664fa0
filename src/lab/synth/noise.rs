//! Errors of reconstructions: training cameras off by a little, and points as these cameras place them.

use super::random::KeyedRandom;
use crate::scene::{Camera, Dataset, Similarity, Split};
use glam::{DMat3, DQuat, DVec3};

/// Root mean square error of a camera's orientation, degrees.
const TURN_DEGREES: f64 = 0.5;

/// Root mean square error of a camera's centre as a share of the scene extent.
const SHIFT: f64 = 0.005;

/// Least sine of the angle between the farthest rays of a point that is placed: a degree.
const PARALLAX_MIN: f64 = 0.017;

/// Turns and shifts the training cameras at random, by `amount` times half a degree and half a percent of the extent
/// (rms), without any similarity of all of them. Test cameras stay exact. Points are placed anew where the rays of the
/// moved training cameras that see them come nearest, and dropped where these are too few or too narrow.
pub(super) fn disturb(dataset: &mut Dataset, seed: u64, amount: f64) {
    let extent = dataset.extent();
    let views = dataset.split(Split::Train);
    let exact: Vec<Camera> = views.iter().map(|&view| dataset.views[view].camera).collect();
    let moved: Vec<Camera> = views
        .iter()
        .zip(&exact)
        .map(|(&view, camera)| {
            // A stream apart from those of the points and of exposures.
            let random = &mut KeyedRandom::new(seed ^ 0x90_5e5, view as u64);
            let mut vector = |rms: f64| DVec3::from([(); 3].map(|()| random.normal())) * (amount * rms / 3_f64.sqrt());
            let turn = DQuat::from_scaled_axis(vector(TURN_DEGREES.to_radians()));
            Camera {
                rotation: camera.rotation * DMat3::from_quat(turn),
                position: camera.position + vector(SHIFT * extent),
                ..*camera
            }
        })
        .collect();
    let back = Similarity::between(&exact, &moved).inverse();
    let moved: Vec<Camera> = moved.iter().map(|camera| back.moved(camera)).collect();
    place_points(dataset, &views, &exact, &moved);
    for (&view, camera) in views.iter().zip(moved) {
        dataset.views[view].camera = camera;
    }
}

/// Moves the points to where the moved cameras see them, and drops those that they do not place.
fn place_points(dataset: &mut Dataset, views: &[usize], exact: &[Camera], moved: &[Camera]) {
    let mut rays: Vec<Vec<(DVec3, DVec3)>> = vec![Vec::new(); dataset.points.len()];
    for ((&view, exact), moved) in views.iter().zip(exact).zip(moved) {
        for &point in dataset.tracks.get(view).into_iter().flatten() {
            let place = exact.pixel_from_world(dataset.points[point as usize].position.into());
            if let Some(pixel) = place {
                rays[point as usize].push((moved.position, moved.ray_from_pixel(pixel).normalize()));
            }
        }
    }
    let mut new_from_old = vec![None; dataset.points.len()];
    let mut points = Vec::new();
    for (old, (point, rays)) in dataset.points.iter().zip(&rays).enumerate() {
        if let Some(position) = nearest_to_rays(rays) {
            new_from_old[old] = Some(points.len() as u32);
            let mut point = *point;
            point.position = position.as_vec3().as_dvec3().to_array();
            points.push(point);
        }
    }
    dataset.points = points;
    for seen in &mut dataset.tracks {
        *seen = seen.iter().filter_map(|&old| new_from_old[old as usize]).collect();
    }
}

/// Point with the least sum of squared distances from rays; `None` without parallax.
fn nearest_to_rays(rays: &[(DVec3, DVec3)]) -> Option<DVec3> {
    let wide = |a: &DVec3| rays.iter().any(|(_, b)| a.cross(*b).length() > PARALLAX_MIN);
    if !rays.iter().any(|(_, direction)| wide(direction)) {
        return None;
    }
    let (mut left, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (origin, d) in rays {
        let across = DMat3::IDENTITY - DMat3::from_cols(*d * d.x, *d * d.y, *d * d.z);
        left += across;
        right += across * *origin;
    }
    Some(left.inverse() * right).filter(|point| point.is_finite())
}
