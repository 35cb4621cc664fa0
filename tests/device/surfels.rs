//! Surfels on the device: frames and surfaces beside the reference, extremes, bands and storage.

use crate::common::device;
use crate::common::scenes::{self, Scene, flattened};
use crate::surfaces::{draw_by, draw_with};
use ashfall::gpu::Gpu;
use ashfall::reference::frame::{center, discontinuity_margins, project_all, sorted};
use ashfall::reference::linear::{dot, normalize};
use ashfall::reference::plane::{TangentPlane, surface};
use ashfall::reference::rasterize::{rasterize, weights};
use ashfall::reference::{Splat, Viewpoint};
use ashfall::render::{Capacity, Compatibility, Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use ashfall::scene::{Primitive, ScreenFilter};
use ashfall::{Error, Splats};
use glam::{DQuat, DVec3};

const FILTERS: [ScreenFilter; 2] = [ScreenFilter::Classic, ScreenFilter::Mip];

const OPTIONS: fn() -> RenderOptions = || RenderOptions {
    primitive: Primitive::Surfel,
    with_surface: true,
    ..RenderOptions::default()
};

/// Errors of a picture, in units of what rounding explains: colour, expected depth, median depth and normal.
#[derive(Debug, Default)]
struct Errors {
    pixels: usize,
    surfaces: usize,
    excused: usize,
    worst: [f64; 4],
}

/// A picture beside the reference's. The rounding of a surfel's mean on the screen, and of its plane's distance, counts
/// over the cosine of its plane and the line of sight.
fn compare(gpu: &Gpu, renderer: &mut Renderer, scene: &Scene) -> Errors {
    let image = draw_by(gpu, renderer, scene);
    let found = image.surface.as_ref().unwrap();
    let view = Viewpoint::on(&scene.splats, &scene.camera, &scene.options);
    let all = Splat::<f64>::all(&scene.splats);
    let (splats, splat_from_rank) = sorted(&project_all(&all, &view));
    let plane = |&i: &usize| TangentPlane::of(&all[i], &view);
    let planes: Vec<TangentPlane> = splat_from_rank.iter().map(plane).collect();
    let order: Vec<usize> = (0..splats.len()).collect();
    let margins = discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
    let world_from_view = scene.camera.rotation.transpose();
    let (thresholds, background) = (&scene.options.thresholds, scene.options.background);
    let mut errors = Errors::default();
    for (i, margin) in margins.iter().enumerate() {
        let at = center(i, scene.camera.width as usize);
        let slant: f64 = weights(&splats, &order, at, thresholds)
            .iter()
            .map(|&(index, _)| 1.0 / dot(planes[index].normal, normalize(planes[index].mean)).abs().max(1e-3))
            .sum();
        let unit = 5e-6 + 3e-6 * slant;
        let shown = rasterize(&splats, &order, at, background, thresholds);
        let expected = surface(&splats, &planes, &order, at, thresholds, &view);
        assert!(image.rgb[i].iter().all(|c| c.is_finite()), "pixel {i} is not finite");
        if margin.nearest() < 2.0 * unit || expected.margin < unit {
            errors.excused += 1;
            continue;
        }
        errors.pixels += 1;
        let mut note = |slot: usize, error: f64| errors.worst[slot] = errors.worst[slot].max(error / unit);
        for channel in 0..3 {
            note(0, (f64::from(image.rgb[i][channel]) - shown.color[channel]).abs());
        }
        note(0, (f64::from(image.transmittance[i]) - shown.transmittance).abs());
        let coverage = 1.0 - f64::from(image.transmittance[i]);
        if coverage < 0.5 {
            assert!(found.expected_depth[i].is_nan() && found.median_depth[i].is_nan());
            continue;
        }
        note(
            1,
            (f64::from(found.expected_depth[i]) * coverage / expected.depth - 1.0).abs(),
        );
        note(2, (f64::from(found.median_depth[i]) / expected.median - 1.0).abs());
        let normal = world_from_view * DVec3::from(expected.normal);
        let off = DVec3::from(found.normal[i].map(f64::from)) - normal.normalize();
        note(3, off.length() * normal.length());
        errors.surfaces += 1;
    }
    errors
}

#[test]
fn frames_and_surfaces_agree_with_the_reference() {
    let gpu = device::gpu();
    let mut renderer = Renderer::new(&gpu, OPTIONS()).unwrap();
    for (seed, count, filter) in [
        (81, 60, FILTERS[0]),
        (82, 200, FILTERS[0]),
        (83, 60, FILTERS[1]),
        (84, 200, FILTERS[1]),
    ] {
        for make in [scenes::gentle, scenes::hard] {
            let scene = flattened(make(seed, count, 97, 65, 1), filter);
            let errors = compare(&gpu, &mut renderer, &scene);
            println!("seed {seed}, {filter:?}: {errors:?}");
            assert!(
                errors.worst.iter().all(|&error| error < 1.0),
                "seed {seed}, {filter:?}: {errors:?}"
            );
            assert!(
                errors.excused * 2 < errors.pixels && errors.surfaces > 300,
                "{errors:?}"
            );
        }
    }
}

/// One opaque surfel, its normal and mean in the view.
fn alone(filter: ScreenFilter, mean: DVec3, normal: DVec3, scales: [f64; 2]) -> Scene {
    let mut scene = flattened(scenes::gentle(85, 1, 80, 60, 0), filter);
    let world_from_view = scene.camera.rotation.transpose();
    let q = DQuat::from_rotation_arc(DVec3::Z, world_from_view * normal.normalize());
    scene.splats.mean[0] = (scene.camera.position + world_from_view * mean).as_vec3().to_array();
    scene.splats.quaternion[0] = [q.w, q.x, q.y, q.z].map(|x| x as f32);
    let [u, v] = scales.map(|s| s.ln() as f32);
    scene.splats.log_scale[0] = [u, v, 0.0];
    scene.splats.opacity_logit[0] = 6.0;
    scene
}

#[test]
fn a_surfel_through_the_camera_plane_is_drawn_where_it_is_in_front() {
    let gpu = device::gpu();
    let mut renderer = Renderer::new(&gpu, OPTIONS()).unwrap();
    for filter in FILTERS {
        // Ten times as large as it is far, tilted by more and more.
        for degrees in 0..36 {
            let turn = f64::from(degrees * 5).to_radians();
            let normal = DVec3::new(0.3 * turn.sin(), turn.sin(), turn.cos());
            let scene = alone(filter, DVec3::new(0.05, 0.1, 0.4), normal, [4.0, 4.0]);
            let errors = compare(&gpu, &mut renderer, &scene);
            assert!(errors.worst.iter().all(|&error| error < 1.0), "{degrees}: {errors:?}");
            // Nearly edge-on ones may be excused for their rounding; most are not.
            assert!(errors.pixels * 2 > errors.excused, "{degrees}: {errors:?}");
        }
    }
}

#[test]
fn edge_on_surfels_are_finite_and_right() {
    let gpu = device::gpu();
    let mut renderer = Renderer::new(&gpu, OPTIONS()).unwrap();
    for filter in FILTERS {
        for cosine in [1.0, 0.1, 0.01, 2e-3, 5e-4, 1e-5, 1e-6, 0.0, -1e-3, -0.5] {
            let mean = DVec3::new(0.02, -0.03, 2.0);
            let across = mean.any_orthonormal_vector();
            let normal = across * (1.0f64 - cosine * cosine).sqrt() - mean.normalize() * cosine;
            let errors = compare(&gpu, &mut renderer, &alone(filter, mean, normal, [0.4, 0.1]));
            assert!(errors.worst.iter().all(|&error| error < 1.0), "{cosine}: {errors:?}");
        }
    }
}

#[test]
fn huge_and_tiny_coordinates_and_scales_leave_pictures_finite() {
    let gpu = device::gpu();
    let mut renderer = Renderer::new(&gpu, OPTIONS()).unwrap();
    for filter in FILTERS {
        for scale in [1e-6, 1e-3, 1.0, 1e3, 1e6] {
            let mut scene = flattened(scenes::gentle(86, 80, 64, 48, 0), filter);
            scene
                .splats
                .mean
                .as_flattened_mut()
                .iter_mut()
                .for_each(|x| *x *= scale as f32);
            let raise = (scale as f32).ln();
            scene
                .splats
                .log_scale
                .as_flattened_mut()
                .iter_mut()
                .for_each(|x| *x += raise);
            scene.camera.position *= scale;
            scene.options.near *= scale;
            let errors = compare(&gpu, &mut renderer, &scene);
            assert!(errors.worst.iter().all(|&error| error < 1.0), "{scale}: {errors:?}");
        }
        let mut scene = flattened(scenes::gentle(87, 90, 64, 48, 0), filter);
        for (i, log_scale) in scene.splats.log_scale.iter_mut().enumerate() {
            *log_scale = [[-80.0, 80.0, 0.0], [40.0; 3], [-87.0, -40.0, 0.0], [-2.0, 88.0, 0.0]][i % 4];
        }
        let image = draw_by(&gpu, &mut renderer, &scene);
        assert!(image.rgb.as_flattened().iter().all(|c| c.is_finite()));
        assert!(image.transmittance.iter().all(|t| (0.0..=1.0).contains(t)));
    }
}

fn bits(image: &RenderedImage) -> Vec<u32> {
    let surface = image.surface.as_ref().unwrap();
    let colors = image.rgb.as_flattened().iter().chain(&image.transmittance);
    colors.chain(&surface.median_depth).map(|x| x.to_bits()).collect()
}

#[test]
fn bands_and_the_third_scale_change_no_bit() {
    let gpu = device::gpu();
    for filter in FILTERS {
        let scene = flattened(scenes::hard(88, 180, 97, 65, 1), filter);
        let whole = bits(&draw_with(&gpu, &scene, OPTIONS()));
        let capacity = Capacity {
            isects: 256,
            ..Capacity::LEAST
        };
        let model = Model::upload(&gpu, &scene.splats).unwrap();
        assert!(model.primitive == Primitive::Surfel);
        let mut renderer = Renderer::new(&gpu, RenderOptions { capacity, ..OPTIONS() }).unwrap();
        let view = ViewOptions {
            background: scene.options.background.map(|c| c as f32),
            near: scene.options.near as f32,
            filter,
        };
        let again = renderer.render(&model, &scene.camera, &view).unwrap();
        assert!(bits(&again) == whole);
        let mut thick = scene.clone();
        thick.splats.log_scale.iter_mut().for_each(|s| s[2] = 3.0);
        assert!(
            bits(&draw_with(&gpu, &thick, OPTIONS())) == whole,
            "the third scale is read"
        );
    }
}

#[test]
fn a_renderer_refuses_other_kinds() {
    let gpu = device::gpu();
    let scene = scenes::gentle(89, 3, 16, 16, 0);
    let view = ViewOptions {
        background: [0.0; 3],
        near: 0.1,
        filter: ScreenFilter::Classic,
    };
    let render = |options: RenderOptions, splats: &Splats| {
        let model = Model::upload(&gpu, splats)?;
        Renderer::new(&gpu, options)?.render(&model, &scene.camera, &view)
    };
    let surfels = flattened(scene.clone(), ScreenFilter::Classic).splats;
    assert!(matches!(render(OPTIONS(), &scene.splats), Err(Error::Config(_))));
    assert!(matches!(
        render(RenderOptions::default(), &surfels),
        Err(Error::Config(_))
    ));
    let original = RenderOptions {
        compatibility: Compatibility::Inria,
        with_surface: false,
        ..OPTIONS()
    };
    assert!(matches!(render(original, &surfels), Err(Error::Unsupported { .. })));
}
