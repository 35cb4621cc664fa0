//! Planes of splats: rays are densest there, and limits of flat and of round splats.

use crate::common::scenes;
use ashfall::reference::linear::{Vec3, dot, matrix, normalize, rotation, sub, transform, transpose, vector};
use ashfall::reference::plane::TangentPlane;
use ashfall::reference::project::screen_covariance;
use ashfall::reference::{Splat, Viewpoint};
use ashfall::scene::{Primitive, ScreenFilter};

/// Squared distance of a world point from a splat, in standard deviations.
fn squared_distance(splat: &Splat<f64>, point: Vec3<f64>) -> f64 {
    let local = transform(transpose(rotation(splat.quaternion)), sub(point, splat.mean));
    (0..3).map(|i| (local[i] / splat.log_scale[i].exp()).powi(2)).sum()
}

/// Least of a function with one minimum, by golden sections.
fn minimum(of: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let golden = (5f64.sqrt() - 1.0) / 2.0;
    for _ in 0..200 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if of(a) < of(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

#[test]
fn rays_are_densest_at_planes() {
    let scene = scenes::gentle(71, 200, 97, 65, 0);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let camera = &scene.camera;
    let world_from_view = transpose(matrix(camera.rotation));
    let (mut compared, mut off_means) = (0, 0.0f64);
    for splat in Splat::<f64>::all(&scene.splats) {
        let plane = TangentPlane::of(&splat, &view);
        let [x, y, z] = plane.mean;
        let mean = [
            camera.focal.x * x / z + camera.center.x,
            camera.focal.y * y / z + camera.center.y,
        ];
        for step in [[0.0, 0.0], [1.3, 0.2], [-0.7, 2.0], [3.0, -3.0]] {
            let at = [mean[0] + step[0], mean[1] + step[1]];
            let tilt = plane.tilt(&view);
            if (tilt[0] * step[0] + tilt[1] * step[1]).abs() > plane.range {
                continue;
            }
            let ray = [
                (at[0] - camera.center.x) / camera.focal.x,
                (at[1] - camera.center.y) / camera.focal.y,
                1.0,
            ];
            let position = vector::<f64>(camera.position);
            let point = |depth: f64| {
                let along = transform(world_from_view, ray.map(|r| r * depth));
                [0, 1, 2].map(|i| position[i] + along[i])
            };
            let densest = minimum(|depth| squared_distance(&splat, point(depth)), 0.1 * z, 10.0 * z);
            // Exactly: the densest point is nearer by (distance of the ray / distance of the camera)^2.
            let ratio = squared_distance(&splat, point(densest)) / squared_distance(&splat, position);
            let expected = densest / (1.0 - ratio);
            let found = plane.depth(at, &view);
            // A quadratic function is flat over √ε of its width, here up to a tenth of the depth and three of them.
            assert!(
                (found / expected - 1.0).abs() < 1e-6,
                "{found} at {step:?}, not {expected}"
            );
            compared += 1;
            off_means = off_means.max((z / expected - 1.0).abs());
        }
    }
    assert!(
        compared > 500 && off_means > 0.02,
        "{compared} rays, means off by {off_means}"
    );
}

#[test]
fn discs_and_spheres_have_their_own_normals() {
    let mut scene = scenes::gentle(72, 60, 97, 65, 0);
    for (i, log_scale) in scene.splats.log_scale.iter_mut().enumerate() {
        *log_scale = if i % 2 == 0 { [-3.0, -2.5, -14.0] } else { [-3.0; 3] };
    }
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    for (i, splat) in Splat::<f64>::all(&scene.splats).iter().enumerate() {
        let plane = TangentPlane::of(splat, &view);
        let sight = normalize(plane.mean);
        let toward = dot(plane.normal, sight);
        assert!(toward < 0.0, "splat {i} faces away");
        let view_from_world = matrix(scene.camera.rotation);
        let axis = transform(view_from_world, transpose(rotation(splat.quaternion))[2]);
        let expected = match i % 2 {
            0 => axis.map(|a| -a * dot(axis, sight).signum()),
            _ => sight.map(|s| -s),
        };
        let off = sub(plane.normal, expected);
        // e^(-22) of its length for a disc, but more as it turns edge-on.
        assert!(dot(off, off).sqrt() < 1e-7 / toward.abs(), "splat {i}: {off:?}");
    }
}

#[test]
fn a_plane_keeps_to_three_standard_deviations() {
    let scene = scenes::gentle(73, 50, 97, 65, 0);
    let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    for splat in Splat::<f64>::all(&scene.splats) {
        let plane = TangentPlane::of(&splat, &view);
        let z = plane.mean[2];
        let widest = splat.log_scale.iter().fold(0.0f64, |m, s| m.max(s.exp()));
        for at in [[-1e6, 3.0], [1e6, -1e6], [40.0, 1e7], [5.0, -1e7]] {
            let depth = plane.depth(at, &view);
            let shift = (z / depth - 1.0).abs();
            assert!(depth > 0.0 && shift <= plane.range * (1.0 + 1e-12));
            // Three σ of the plane's depth, whose variance is at most the largest one's over cos².
            let sight = normalize(plane.mean);
            let cos = -dot(plane.normal, sight);
            assert!(shift <= 3.0 * widest / z * 2.0 / cos, "{shift} of {widest} at {z}");
        }
    }
}

#[test]
fn pixels_see_the_mean_depth_of_what_the_mip_filter_brings() {
    let mut scene = scenes::gentle(73, 200, 97, 65, 0);
    scene.splats.primitive = Primitive::Surfel;
    scene.splats.filter = ScreenFilter::Mip;
    for log_scale in scene.splats.log_scale.iter_mut().step_by(2) {
        *log_scale = log_scale.map(|s| s - 2.0);
    }
    let view = Viewpoint::on(&scene.splats, &scene.camera, &scene.options);
    let k = view.dilation;
    let (mut compared, mut level) = (0, 0);
    for splat in Splat::<f64>::all(&scene.splats) {
        let plane = TangentPlane::of(&splat, &view);
        let [xx, xy, yy] = screen_covariance(&splat, &view, matrix(scene.camera.rotation), plane.mean);
        // The quadrature resolves the filter beside surfels of up to three pixels.
        if xx + yy > 9.0 || xx * yy - xy * xy < 1e-6 * xx * yy {
            continue;
        }
        let (tilt, filtered) = (plane.tilt(&view), plane.filtered.unwrap());
        // The covariance's triangular root takes standard deviations to pixels.
        let (x, slope) = (xx.sqrt(), xy / xx.sqrt());
        let y = (yy - slope * slope).sqrt();
        for d in [[1.0, 0.0], [-0.5, 0.8]] {
            let (mut sum, mut total) = (0.0, 0.0);
            for step in 0..281 * 281 {
                let [u, v] = [step / 281, step % 281].map(|i| f64::from(i) * 0.05 - 7.0);
                let at = [x * u, slope * u + y * v];
                let off = (d[0] - at[0]).powi(2) + (d[1] - at[1]).powi(2);
                let weight = (-0.5 * (u * u + v * v) - 0.5 * off / k).exp();
                sum += weight * (tilt[0] * at[0] + tilt[1] * at[1]);
                total += weight;
            }
            let (found, expected) = (filtered[0] * d[0] + filtered[1] * d[1], sum / total);
            let size = tilt[0].hypot(tilt[1]);
            assert!((found - expected).abs() <= 1e-8 * size, "{found}, not {expected}");
            level += u32::from(found.abs() < 0.5 * (tilt[0] * d[0] + tilt[1] * d[1]).abs());
            compared += 1;
        }
    }
    assert!(compared > 50 && level > 10, "{compared} pixels, {level} nearly level");
}
