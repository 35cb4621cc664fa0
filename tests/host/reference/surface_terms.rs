//! Terms of geometry: planes, sheets, invariance, and derivatives against finite differences.

use super::{assert_close, central_difference};
use crate::common::scenes;
use ashfall::reference::frame::{center, project_all, sorted};
use ashfall::reference::linear::{normalize, scale};
use ashfall::reference::plane::{SurfacePixel, TangentPlane, surface};
use ashfall::reference::surface_loss::{SurfaceWeights, inconsistency, pixel_loss, surface_loss_backward};
use ashfall::reference::{Options, Splat, Viewpoint};
use ashfall::scene::{Camera, ScreenFilter};
use glam::{DMat3, DVec2, DVec3};

fn camera() -> Camera {
    Camera {
        width: 40,
        height: 30,
        focal: DVec2::new(36.0, 41.0),
        center: DVec2::new(12.0, 17.0),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
}

/// Surface of the plane `normal · x = 1` at a pixel, in units of `size`.
fn on_plane(normal: [f64; 3], size: f64, pixel: usize) -> SurfacePixel {
    let camera = camera();
    let at = DVec2::new((pixel % 40) as f64 + 0.5, (pixel / 40) as f64 + 0.5);
    let ray = ((at - camera.center) / camera.focal).extend(1.0);
    let coverage = 0.8;
    SurfacePixel {
        coverage,
        depth: coverage * size / DVec3::from(normal).dot(ray),
        median: 0.0,
        interquartile: 0.0,
        normal: scale(-0.6, normalize(normal)),
        first: 1.0,
        spread: 0.0,
        log: 0.0,
        margin: 0.5,
    }
}

#[test]
fn planes_are_consistent_at_every_tilt_and_size() {
    for normal in [[0.0, 0.0, 1.0], [0.4, -0.7, 1.0], [-1.1, 0.2, 0.9]] {
        for size in [1e-3, 1.0, 1e6] {
            let (mut seen, mut turned) = (0, 0.0);
            for pixel in 0..40 * 30 {
                let Some(term) = inconsistency(|i| on_plane(normal, size, i), &camera(), pixel) else {
                    continue;
                };
                assert!(term.abs() < 1e-12, "{normal:?}: {term:e}");
                seen += 1;
                // A quarter turn of the normal alone costs 1.
                let other = normalize([normal[2], 0.0, -normal[0]]);
                let of = |i| SurfacePixel {
                    normal: other,
                    ..on_plane(normal, size, i)
                };
                turned += inconsistency(of, &camera(), pixel).unwrap_or(0.0);
            }
            assert!(seen > 500, "{seen} pixels of {normal:?}");
            assert_close(turned / f64::from(seen), 1.0, 1e-12, 1.0);
        }
    }
}

#[test]
fn pixels_without_a_surface_and_steps_have_no_term() {
    let weights = SurfaceWeights {
        normal: 1.0,
        spread: 1.0,
    };
    let middle = 15 * 40 + 20;
    let term = |change: &dyn Fn(usize, &mut SurfacePixel)| {
        let at = |i: usize| {
            let mut pixel = on_plane([0.3, 0.1, 1.0], 1.0, i);
            pixel.normal = [0.6, 0.0, -0.6];
            pixel.spread = 0.01;
            change(i, &mut pixel);
            pixel
        };
        pixel_loss(at, &camera(), weights, middle)
    };
    let all = term(&|_, _| ());
    let spread = 0.8 * 0.01;
    assert!(all > 2.0 * spread);
    for neighbour in [middle - 1, middle + 1, middle - 40, middle + 40] {
        let open = term(&|i, pixel| pixel.coverage = if i == neighbour { 0.49 } else { pixel.coverage });
        assert_eq!(open, spread);
        let step = term(&|i, pixel| pixel.depth *= if i == neighbour { 1.3 } else { 1.0 });
        assert_eq!(step, spread);
    }
    assert_eq!(term(&|_, pixel| pixel.coverage = 0.3), 0.0);
    assert_eq!(term(&|_, pixel| pixel.normal = [0.01, 0.0, -0.01]), spread);
}

/// Surfaces of a frame.
fn surfaces(splats: &[Splat<f64>], view: &Viewpoint, options: &Options) -> Vec<SurfacePixel> {
    let (list, splat_from_rank) = sorted(&project_all(splats, view));
    let planes: Vec<TangentPlane> = splat_from_rank
        .iter()
        .map(|&i| TangentPlane::of(&splats[i], view))
        .collect();
    let order: Vec<usize> = (0..list.len()).collect();
    let width = view.camera.width as usize;
    (0..width * view.camera.height as usize)
        .map(|i| surface(&list, &planes, &order, center(i, width), &options.thresholds, view))
        .collect()
}

#[test]
fn derivatives_are_finite_differences_with_constant_coverages() {
    let options = Options::default();
    let weights = SurfaceWeights {
        normal: 0.5,
        spread: 3.0,
    };
    let mut scene = scenes::gentle(181, 24, 17, 13, 0);
    for i in 0..24 {
        // So large and faint that none reaches beyond the range of its plane.
        scene.splats.log_scale[i].iter_mut().for_each(|s| *s += 1.1);
        scene.splats.opacity_logit[i] = -0.9;
    }
    for scene in [scene.clone(), scenes::flattened(scene, ScreenFilter::Mip)] {
        let view = Viewpoint::on(&scene.splats, &scene.camera, &options);
        let splats = Splat::<f64>::all(&scene.splats);
        let slopes = surface_loss_backward(&splats, &view, &options, weights);
        let before = surfaces(&splats, &view, &options);
        let loss = |splat: usize, parameter: usize, value: f64| -> f64 {
            let mut changed = splats.clone();
            let mut row = changed[splat].parameters();
            row[parameter] = value;
            changed[splat] = Splat::from_parameters(&row);
            let after = surfaces(&changed, &view, &options);
            let terms = before.iter().enumerate().filter(|(_, at)| at.coverage >= 0.5);
            terms
                .map(|(i, at)| {
                    let normal = inconsistency(|j| after[j], &scene.camera, i).unwrap_or(0.0);
                    at.coverage * (weights.normal * normal + weights.spread * after[i].spread)
                })
                .sum()
        };
        let (mut compared, mut size) = (0, 0.0f64);
        for (splat, parameter) in [(0, 0), (1, 2), (2, 3), (3, 5), (4, 7), (5, 8), (6, 10), (7, 1), (8, 4)] {
            let value = splats[splat].parameters()[parameter];
            let found = slopes[splat][parameter];
            let of = |step: f64| central_difference(|x| loss(splat, parameter, x), value, step);
            // Where a splat ends, or a pixel has hardly a surface, a difference says nothing.
            if (of(1e-7) - of(3e-7)).abs() < 1e-4 * found.abs().max(1e-2) {
                assert_close(found, of(1e-7), 1e-4, 1e-2);
                compared += 1;
            }
            size = size.max(found.abs());
        }
        assert!(compared >= 5 && size > 1e-2, "{compared} of size {size}");
    }
}
