//! Surfels: hits against closed forms, derivatives against differences, and extremes.

use super::{assert_close, central_difference};
use crate::common::scenes::{self, Scene};
use ashfall::reference::gradient::loss_derivatives;
use ashfall::reference::linear::{dot, normalize};
use ashfall::reference::loss::Target;
use ashfall::reference::primitive::power;
use ashfall::reference::project::determinant;
use ashfall::reference::surfel::{EDGE_COSINE, SurfelDisc};
use ashfall::reference::{ScreenSplat, Splat, Viewpoint, loss_gradient, project, render};
use ashfall::scene::{Primitive, ScreenFilter};
use glam::{DQuat, DVec3};

/// A gentle scene of surfels.
fn surfels(seed: u64, count: usize, filter: ScreenFilter) -> Scene {
    let mut scene = scenes::gentle(seed, count, 49, 33, 1);
    scene.splats.primitive = Primitive::Surfel;
    scene.splats.filter = filter;
    scene.splats.set_thickness();
    scene
}

fn view_of(scene: &Scene) -> Viewpoint {
    Viewpoint::on(&scene.splats, &scene.camera, &scene.options)
}

/// Splats on the screen with their discs, none edge-on.
fn discs(scene: &Scene) -> Vec<(ScreenSplat<f64>, SurfelDisc<f64>)> {
    let view = view_of(scene);
    let all = Splat::<f64>::all(&scene.splats);
    let drawn = all.iter().filter_map(|splat| project(splat, &view));
    drawn.filter_map(|s| s.disc.map(|disc| (s, disc))).collect()
}

/// Residual and depth over that of the mean in the centred form: the ellipse at the mean, in perspective.
fn centred(screen: &ScreenSplat<f64>, disc: &SurfelDisc<f64>, at: [f64; 2]) -> (f64, f64) {
    let [fx, fy, ..] = disc.lens;
    let along = dot(disc.normal, disc.mean);
    let tilt = [disc.normal[0] / fx, disc.normal[1] / fy].map(|n| disc.mean[2] * n / along);
    let d = [at[0] - screen.mean[0], at[1] - screen.mean[1]];
    let w = 1.0 / (1.0 + tilt[0] * d[0] + tilt[1] * d[1]);
    let [xx, xy, yy] = screen.covariance;
    let form = (yy * d[0] * d[0] - 2.0 * xy * d[0] * d[1] + xx * d[1] * d[1]) / determinant(screen.covariance);
    (w * w * form, w)
}

const STEPS: [[f64; 2]; 5] = [[0.2, 0.1], [1.3, 0.2], [-0.7, 2.0], [3.0, -3.0], [-6.0, -5.0]];

#[test]
fn hits_are_the_ellipse_at_the_mean_in_perspective() {
    let scene = surfels(11, 300, ScreenFilter::Classic);
    let mut compared = 0;
    for (screen, disc) in discs(&scene) {
        for step in STEPS {
            let at = [screen.mean[0] + step[0], screen.mean[1] + step[1]];
            let Some(hit) = disc.hit(at) else {
                continue;
            };
            let (squared, w) = centred(&screen, &disc, at);
            // The camera's rotation is rounded to floats: the normal is at right angles to the axes but for 1e-7, times
            // the distance in standard deviations, over the cosine, and twice that for the covariance's determinant.
            let cos = dot(disc.normal, normalize(disc.mean)).abs();
            assert_close(hit.u * hit.u + hit.v * hit.v, squared, 1e-6 / (cos * cos), 1e-3);
            assert_close(hit.depth / disc.mean[2], w, 1e-6 / cos, 1.0);
            compared += 1;
        }
    }
    assert!(compared > 1_000, "{compared} hits");
}

#[test]
fn alphas_are_those_of_hits_or_of_spots() {
    let scene = surfels(12, 300, ScreenFilter::Classic);
    let mut spots = 0;
    for (screen, disc) in discs(&scene) {
        for [x, y] in STEPS {
            let at = [screen.mean[0] + x, screen.mean[1] + y];
            let flat = disc
                .hit(at)
                .map_or(f64::INFINITY, |hit| 0.5 * (hit.u * hit.u + hit.v * hit.v));
            let spot = x * x + y * y;
            assert_close(power(&screen, at), flat.min(spot), 1e-9, 1e-6);
            spots += u32::from(spot < flat);
        }
    }
    assert!(spots > 50, "{spots} spots");
}

#[test]
fn nothing_behind_the_camera_or_the_horizon_is_hit() {
    let mut scene = surfels(13, 1, ScreenFilter::Mip);
    let camera = scene.camera;
    let ahead = camera.rotation.row(2);
    // A ground below the camera, which sees its horizon.
    let mean = camera.position + camera.rotation.transpose() * DVec3::new(0.0, 1.0, 3.0);
    let normal = camera.rotation.row(1);
    let q = DQuat::from_rotation_arc(DVec3::Z, normal);
    scene.splats.mean[0] = mean.as_vec3().to_array();
    scene.splats.quaternion[0] = [q.w, q.x, q.y, q.z].map(|x| x as f32);
    scene.splats.log_scale[0] = [4.0, 4.0, 0.0];
    let (screen, disc) = discs(&scene)[0];
    let mut seen = [0; 2];
    for y in 0..camera.height {
        let at = [camera.center.x, f64::from(y) + 0.5];
        let is_below = at[1] > camera.center.y;
        match disc.hit(at) {
            Some(hit) => {
                let expected = 1.0 * camera.focal.y / (at[1] - camera.center.y);
                assert!(is_below, "the horizon is at the middle");
                assert_close(hit.depth, expected, 1e-5, 1.0);
                assert_close(disc.depth(at), expected.min(disc.depth_range()[1]), 1e-5, 1.0);
            }
            None => {
                assert!(!is_below && power(&screen, at) == f64::INFINITY);
                assert_eq!(disc.depth(at), disc.depth_range()[1]);
            }
        }
        seen[usize::from(is_below)] += 1;
    }
    assert!(seen[0] > 5 && seen[1] > 5, "{seen:?}");
    // Behind the camera it is not drawn.
    scene.splats.mean[0] = (camera.position - ahead).as_vec3().to_array();
    assert!(discs(&scene).is_empty());
}

/// A surfel before the camera whose normal has a cosine with the line of sight.
fn slanted(filter: ScreenFilter, cosine: f64, log_scale: f32) -> Scene {
    let mut scene = surfels(14, 1, filter);
    let camera = scene.camera;
    let normal = DVec3::new(0.0, (1.0f64 - cosine * cosine).sqrt(), cosine);
    let q = DQuat::from_rotation_arc(DVec3::Z, camera.rotation.transpose() * normal);
    let mean = camera.position + camera.rotation.transpose() * DVec3::new(0.0, 0.0, 2.0);
    scene.splats.mean[0] = mean.as_vec3().to_array();
    scene.splats.quaternion[0] = [q.w, q.x, q.y, q.z].map(|x| x as f32);
    scene.splats.log_scale[0] = [log_scale, log_scale, 0.0];
    scene
}

#[test]
fn nearly_edge_on_surfels_draw_no_streaks() {
    let mut streaks = 0;
    for cosine in [0.3, 0.1, 0.03, 0.01, 0.003, 0.0015] {
        let (screen, disc) = discs(&slanted(ScreenFilter::Mip, cosine, -2.0))[0];
        let [_, _, yy] = screen.covariance;
        for step in 1..200 {
            let off = f64::from(step) * 0.1;
            for y in [-off, off] {
                let at = [screen.mean[0], screen.mean[1] + y];
                let (squared, w) = centred(&screen, &disc, at);
                let visible = 2.0 * (255.0 * screen.opacity).ln();
                // In the perspective of its whole tilt a surfel would reach there.
                streaks += u32::from(off > 5.0 * yy.sqrt() && w > 0.0 && squared < visible);
                assert!(
                    off <= 5.0 * yy.sqrt() || 2.0 * power(&screen, at) > visible,
                    "{cosine}: drawn {y} px off"
                );
            }
        }
    }
    assert!(streaks > 10, "{streaks}");
}

#[test]
fn edge_on_surfels_are_spots_or_not_drawn() {
    for (filter, cosine) in [ScreenFilter::Classic, ScreenFilter::Mip]
        .into_iter()
        .flat_map(|filter| [1e-1, 1e-2, 2e-3, 5e-4, 1e-6, 0.0].map(|c| (filter, c)))
    {
        let found = discs(&slanted(filter, cosine, -2.5));
        let is_edge_on = cosine < EDGE_COSINE;
        if filter == ScreenFilter::Mip {
            assert_eq!(found.is_empty(), is_edge_on, "{cosine}");
            continue;
        }
        let (screen, disc) = found[0];
        assert_eq!(disc.is_edge_on, is_edge_on, "{cosine}");
        for [x, y] in STEPS {
            let at = [screen.mean[0] + x, screen.mean[1] + y];
            let found = power(&screen, at);
            let spot = x * x + y * y;
            assert!(found <= spot * (1.0 + 1e-9), "{cosine}");
            assert!(!is_edge_on || disc.hit(at).is_none() && found >= spot * (1.0 - 1e-9));
        }
    }
}

#[test]
fn the_sign_of_the_normal_changes_nothing() {
    for filter in [ScreenFilter::Classic, ScreenFilter::Mip] {
        let scene = surfels(15, 80, filter);
        let mut turned = scene.clone();
        for q in &mut turned.splats.quaternion {
            // Half a turn about the first axis.
            let [w, x, y, z] = *q;
            *q = [-x, w, z, -y];
        }
        let [a, b] = [&scene, &turned].map(|s| render(&s.splats, &s.camera, &s.options));
        for (a, b) in a.pixels.iter().zip(&b.pixels) {
            assert_close(a.color[0], b.color[0], 1e-11, 1.0);
        }
    }
}

#[test]
fn neither_distance_from_the_origin_nor_units_matter() {
    let scene = surfels(16, 60, ScreenFilter::Classic);
    let near = render(&scene.splats, &scene.camera, &scene.options);
    // Means and camera move by whole units that floats of this size hold.
    let mut far = scene.clone();
    let shift = 65_536.0;
    let rounded = |x: f32| (f64::from(x) + shift) as f32;
    for mean in &mut far.splats.mean {
        *mean = mean.map(rounded);
    }
    far.camera.position += DVec3::splat(shift);
    let mut back = far.clone();
    back.camera.position -= DVec3::splat(shift);
    for mean in &mut back.splats.mean {
        *mean = mean.map(|x| (f64::from(x) - shift) as f32);
    }
    let [far, back] = [&far, &back].map(|s| render(&s.splats, &s.camera, &s.options));
    for (a, b) in far.pixels.iter().zip(&back.pixels) {
        assert_close(a.color[1], b.color[1], 1e-8, 1.0);
    }
    for scale in [1e-3_f64, 1e3] {
        let mut other = scene.clone();
        other
            .splats
            .mean
            .as_flattened_mut()
            .iter_mut()
            .for_each(|x| *x *= scale as f32);
        let raise = scale.ln() as f32;
        other
            .splats
            .log_scale
            .as_flattened_mut()
            .iter_mut()
            .for_each(|x| *x += raise);
        other.camera.position *= scale;
        other.options.near *= scale;
        let other = render(&other.splats, &other.camera, &other.options);
        for (a, b) in near.pixels.iter().zip(&other.pixels) {
            // Floats of the moved parameters.
            assert_close(a.color[2], b.color[2], 1e-4, 1.0);
            assert_close(a.depth * scale, b.depth, 1e-4, scale);
        }
    }
}

#[test]
fn gradients_are_those_of_duals_and_of_differences() {
    for filter in [ScreenFilter::Classic, ScreenFilter::Mip] {
        let mut scene = surfels(17, 12, filter);
        scene.camera.width = 25;
        scene.camera.height = 17;
        scene.options.thresholds = ashfall::reference::Thresholds::NONE;
        let photo = scenes::photo_values(&scenes::photo(7, 25, 17));
        let target = Target::new(25, &photo);
        let (camera, options) = (&scene.camera, &scene.options);
        let whole = loss_gradient(&scene.splats, camera, options, &target).d_splats;
        let parameters: Vec<(usize, usize)> = (0..12).flat_map(|s| (0..14).map(move |p| (s, p))).collect();
        let duals = loss_derivatives(&scene.splats, camera, options, &target, &parameters);
        let scale = duals.iter().fold(0.0f64, |m, d| m.max(d.abs()));
        for (&(splat, parameter), &dual) in parameters.iter().zip(&duals) {
            let row = match parameter {
                0..3 => whole.mean[splat][parameter],
                3..7 => whole.quaternion[splat][parameter - 3],
                7..10 => whole.log_scale[splat][parameter - 7],
                10 => whole.opacity_logit[splat],
                _ => whole.sh[splat * scene.splats.sh_stride() + parameter - 11],
            };
            assert_close(row, dual, 1e-9, 1e-6 * scale);
            if parameter == 9 {
                assert_eq!(dual, 0.0, "the third scale is not drawn");
            }
        }
        // One splat's alpha by differences.
        let view = view_of(&scene);
        let splat = Splat::<f64>::of(&scene.splats, 3);
        let row = splat.parameters();
        let mut checked = 0;
        for step in STEPS {
            let Some(screen) = project(&splat, &view) else {
                continue;
            };
            let at = [screen.mean[0] + step[0], screen.mean[1] + step[1]];
            for parameter in 0..9 {
                let with = |value: f64| {
                    let mut row = row.clone();
                    row[parameter] = value;
                    let moved = project(&Splat::from_parameters(&row), &view);
                    moved.map_or(f64::NAN, |s| power(&s, at))
                };
                let slope = central_difference(with, row[parameter], 1e-5);
                let mut lifted: Vec<_> = row
                    .iter()
                    .map(|&v| ashfall::reference::Dual::<1>::variable(v, None))
                    .collect();
                lifted[parameter] = ashfall::reference::Dual::variable(row[parameter], Some(0));
                let lifted = project(&Splat::from_parameters(&lifted), &view).map(|s| power(&s, at));
                let dual = lifted.map_or(f64::NAN, |p| p.d[0]);
                assert_close(slope, dual, 1e-6, 1e-3);
                checked += 1;
            }
        }
        assert_eq!(checked, 45);
    }
}

#[test]
fn depths_are_of_the_plane_and_continuous_where_the_spot_begins() {
    let scene = surfels(18, 200, ScreenFilter::Classic);
    let mut met = 0;
    for (screen, disc) in discs(&scene) {
        let mut before: Option<f64> = None;
        let [low, high] = disc.depth_range();
        // Steps over a fiftieth of the range, so that a jump is none of the plane's own.
        let along = dot(disc.normal, disc.mean);
        let tilt = (disc.normal[0] / disc.lens[0]).hypot(disc.normal[1] / disc.lens[1]) * disc.mean[2] / along;
        let step = (0.01 * (high - low) / disc.mean[2] / tilt.abs().max(1e-9)).min(0.01);
        for i in 0..400 {
            let at = [
                screen.mean[0] + step * f64::from(i),
                screen.mean[1] - 0.5 * step * f64::from(i),
            ];
            let depth = disc.depth(at);
            assert!((low..=high).contains(&depth));
            if let Some(hit) = disc.hit(at).filter(|hit| hit.u.hypot(hit.v) <= 3.33) {
                let cos = dot(disc.normal, normalize(disc.mean)).abs();
                assert_close(depth, hit.depth, 1e-6 / cos, 1.0);
                met += 1;
            }
            if let Some(before) = before {
                assert!((depth - before).abs() <= 0.1 * (high - low) + 1e-9, "a jump");
            }
            before = Some(depth);
        }
    }
    assert!(met > 1_000, "{met}");
}
