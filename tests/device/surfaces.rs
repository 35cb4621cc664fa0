//! Depths and normals of frames: beside the reference, of planes, and of nothing.

use crate::common::device;
use crate::common::scenes::{self, Scene};
use ashfall::Error;
use ashfall::gpu::Gpu;
use ashfall::kernels::rasterize::{self, Outputs};
use ashfall::reference::frame::{center, discontinuity_margins, project_all, sorted};
use ashfall::reference::plane::{TangentPlane, surface};
use ashfall::reference::{Options, Splat, Viewpoint};
use ashfall::render::{Capacity, Compatibility, Model, RenderOptions, RenderedImage, Renderer, Surface, ViewOptions};
use ashfall::scene::{Camera, ScreenFilter, Splats};
use glam::{DMat3, DQuat, DVec2, DVec3};

pub(crate) fn draw_with(gpu: &Gpu, scene: &Scene, options: RenderOptions) -> RenderedImage {
    draw_by(gpu, &mut Renderer::new(gpu, options).unwrap(), scene)
}

pub(crate) fn draw_by(gpu: &Gpu, renderer: &mut Renderer, scene: &Scene) -> RenderedImage {
    let model = Model::upload(gpu, &scene.splats).unwrap();
    let view = ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        filter: scene.splats.filter,
    };
    renderer.render(&model, &scene.camera, &view).unwrap()
}

const WITH_SURFACE: fn() -> RenderOptions = || RenderOptions {
    with_surface: true,
    ..RenderOptions::default()
};

fn draw(gpu: &Gpu, scene: &Scene) -> (RenderedImage, Surface) {
    let mut image = draw_with(gpu, scene, WITH_SURFACE());
    let surface = image.surface.take().unwrap();
    (image, surface)
}

/// A disc in view terms: pixel and depth of its mean, normal, standard deviation in its plane in world units.
struct Disc {
    pixel: [f64; 2],
    depth: f64,
    normal: DVec3,
    sigma: f64,
    logit: f32,
}

/// A turned camera with an off-centre principal point and pixels that are not square.
fn stage(width: u32, height: u32) -> Scene {
    Scene {
        splats: Splats::default(),
        camera: Camera {
            width,
            height,
            focal: DVec2::new(60.0, 80.0),
            center: DVec2::new(0.3 * f64::from(width), 0.6 * f64::from(height)),
            rotation: DMat3::from_quat(DQuat::from_xyzw(0.3, -0.2, 0.5, 0.8).normalize()),
            position: DVec3::new(0.5, -1.0, 2.0),
        },
        options: Options {
            near: 1e-3,
            ..Options::default()
        },
    }
}

fn place(scene: &mut Scene, disc: &Disc) {
    let camera = &scene.camera;
    let ray = ((DVec2::from(disc.pixel) - camera.center) / camera.focal).extend(1.0);
    let world_from_view = camera.rotation.transpose();
    let mean = camera.position + world_from_view * (ray * disc.depth);
    let q = DQuat::from_rotation_arc(DVec3::Z, (world_from_view * disc.normal).normalize());
    let splats = &mut scene.splats;
    splats.mean.push(mean.as_vec3().to_array());
    splats.quaternion.push([q.w, q.x, q.y, q.z].map(|x| x as f32));
    let log = disc.sigma.ln() as f32;
    splats.log_scale.push([log, log, log - 9.0]);
    splats.opacity_logit.push(disc.logit);
    splats.sh.extend([0.3; 3].iter().take(splats.sh_stride()));
}

/// Depth at a pixel's centre of the plane `normal · x = offset` in the view.
fn plane_depth(camera: &Camera, pixel: usize, normal: DVec3, offset: f64) -> f64 {
    let at = DVec2::from(center(pixel, camera.width as usize));
    offset / normal.dot(((at - camera.center) / camera.focal).extend(1.0))
}

/// A wall of opaque discs in the plane `normal · x = offset`, `scale` times as large and as far.
fn wall(normal: DVec3, scale: f64) -> Scene {
    let mut scene = stage(64, 48);
    scene.camera.position *= scale;
    for i in 0..40 * 32 {
        let pixel = [f64::from(i % 40) * 2.0 - 8.0, f64::from(i / 40) * 2.0 - 8.0];
        let ray = ((DVec2::from(pixel) - scene.camera.center) / scene.camera.focal).extend(1.0);
        let disc = Disc {
            pixel,
            depth: scale * 4.0 / normal.dot(ray),
            normal,
            sigma: scale * 0.3,
            // So faint that each ends within three standard deviations, beyond which its depth is held.
            logit: -1.1,
        };
        place(&mut scene, &disc);
    }
    scene
}

#[test]
fn surfaces_change_no_bit_of_the_picture() {
    let gpu = device::gpu();
    let variant = |surface| {
        let outputs = Outputs {
            surface,
            ..Outputs::default()
        };
        rasterize::Choice::prefer(gpu.caps(), outputs).variant
    };
    // Two variants of the kernel round differently.
    let is_same = variant(false) == variant(true);
    let agree = |a: f32, b: f32| a.to_bits() == b.to_bits() || !is_same && (a - b).abs() <= 2e-6;
    for scene in [scenes::gentle(61, 300, 97, 65, 2), scenes::hard(62, 180, 64, 48, 1)] {
        let channels = |options| -> Vec<f32> {
            let image = draw_with(&gpu, &scene, options);
            [image.rgb.as_flattened(), &image.transmittance].concat()
        };
        let (without, with) = (channels(RenderOptions::default()), channels(WITH_SURFACE()));
        assert!(without.iter().zip(&with).all(|(&a, &b)| agree(a, b)));
    }
}

#[test]
fn frames_agree_with_the_reference() {
    let gpu = device::gpu();
    for (seed, count, filter) in [(63, 120, ScreenFilter::Classic), (64, 300, ScreenFilter::Mip)] {
        let mut scene = scenes::gentle(seed, count, 97, 65, 0);
        scene.splats.filter = filter;
        let (image, found) = draw(&gpu, &scene);
        let view = Viewpoint::new(&scene.camera, &scene.options, filter);
        let all = Splat::<f64>::all(&scene.splats);
        let (splats, splat_from_rank) = sorted(&project_all(&all, &view));
        let planes: Vec<TangentPlane> = splat_from_rank
            .iter()
            .map(|&i| TangentPlane::of(&all[i], &view))
            .collect();
        let order: Vec<usize> = (0..splats.len()).collect();
        let margins = discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
        let world_from_view = scene.camera.rotation.transpose();
        let (mut surfaces, mut worst) = (0, [0.0f64; 4]);
        for (i, margin) in margins.iter().enumerate() {
            let thresholds = &scene.options.thresholds;
            let expected = surface(&splats, &planes, &order, center(i, 97), thresholds, &view);
            let coverage = 1.0 - f64::from(image.transmittance[i]);
            if margin.nearest() < 1e-4 || expected.margin < 1e-4 {
                continue;
            }
            if coverage < 0.5 {
                let all = [
                    found.expected_depth[i],
                    found.median_depth[i],
                    found.interquartile_depth[i],
                ];
                assert!(all.iter().chain(&found.normal[i]).all(|x| x.is_nan()), "pixel {i}");
                continue;
            }
            surfaces += 1;
            let normal = (world_from_view * DVec3::from(expected.normal)).normalize();
            let off = DVec3::from(found.normal[i].map(f64::from)) - normal;
            let mean = expected.depth / coverage;
            let interquartile = expected.interquartile / (expected.coverage.min(0.75) - 0.25);
            let errors = [
                (f64::from(found.expected_depth[i]) / mean - 1.0).abs(),
                (f64::from(found.median_depth[i]) / expected.median - 1.0).abs(),
                off.length() * DVec3::from(expected.normal).length(),
                (f64::from(found.interquartile_depth[i]) / interquartile - 1.0).abs(),
            ];
            worst = [0, 1, 2, 3].map(|k| worst[k].max(errors[k]));
        }
        println!("seed {seed}: {surfaces} surfaces, worst {worst:?}");
        assert!(surfaces > 500, "{surfaces} pixels with a surface");
        // As in `surface_outputs`, with means in the rounding of the projection: 1e-6 of the image beside it.
        assert!(worst.iter().all(|&error| error < 1e-4), "{worst:?}");
    }
}

#[test]
fn a_wall_of_discs_is_a_plane() {
    let gpu = device::gpu();
    let normal = DVec3::new(0.4, -0.3, 0.8).normalize();
    let toward = |camera: &Camera| (camera.rotation.transpose() * -normal).as_vec3();
    let mut depths: Vec<Vec<f32>> = Vec::new();
    for scale in [1.0, 1e-3, 1e3] {
        let scene = wall(normal, scale);
        let (image, found) = draw(&gpu, &scene);
        let camera = &scene.camera;
        for i in 0..64 * 48 {
            assert!(image.transmittance[i] < 0.1, "pixel {i} is open");
            let exact = plane_depth(camera, i, normal, scale * 4.0);
            for depth in [found.expected_depth[i], found.median_depth[i]] {
                // The mean's rounding in the world, u of 10 scales, over the cosine, of a depth from 3 scales.
                let error = (f64::from(depth) / exact - 1.0).abs();
                assert!(error < 1e-5, "pixel {i} of scale {scale}: {depth}, not {exact}");
            }
            let off = glam::Vec3::from(found.normal[i]) - toward(camera);
            assert!(off.length() < 1e-4, "pixel {i}: normal {:?}", found.normal[i]);
        }
        depths.push(found.median_depth.iter().map(|z| z / scale as f32).collect());
    }
    for other in &depths[1..] {
        for (a, b) in depths[0].iter().zip(other) {
            assert!((a / b - 1.0).abs() < 2e-5, "{a} and {b}");
        }
    }
}

#[test]
fn one_large_disc_has_the_depth_of_its_plane() {
    let gpu = device::gpu();
    // Tilted both ways, to 80 degrees.
    for normal in [[0.3, 0.2, 1.0], [-4.0, 1.0, 1.0], [0.2, -5.0, -1.0]].map(DVec3::from) {
        let mut scene = stage(64, 48);
        let disc = Disc {
            pixel: [30.0, 22.0],
            depth: 5.0,
            normal,
            sigma: 2.0,
            logit: 9.0,
        };
        place(&mut scene, &disc);
        let (_, found) = draw(&gpu, &scene);
        let ray = ((DVec2::from(disc.pixel) - scene.camera.center) / scene.camera.focal).extend(1.0);
        let offset = normal.dot(ray * disc.depth);
        let view = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
        let range = TangentPlane::of(&Splat::<f64>::of(&scene.splats, 0), &view).range;
        let mut seen = 0;
        for i in 0..64 * 48 {
            let exact = plane_depth(&scene.camera, i, normal, offset);
            let depth = f64::from(found.median_depth[i]);
            if depth.is_nan() || (disc.depth / exact - 1.0).abs() > 0.99 * range {
                continue;
            }
            seen += 1;
            assert!(
                (depth / exact - 1.0).abs() < 2e-5,
                "{normal}, pixel {i}: {depth}, not {exact}"
            );
            assert!(
                (f64::from(found.expected_depth[i]) / exact - 1.0).abs() < 2e-5,
                "{normal}, pixel {i}"
            );
        }
        assert!(seen > 100, "{normal}: {seen} pixels");
    }
}

#[test]
fn the_sides_of_a_disc_look_alike() {
    let gpu = device::gpu();
    let normal = DVec3::new(0.5, 0.4, 0.7).normalize();
    let front = wall(normal, 1.0);
    let mut back = front.clone();
    for q in &mut back.splats.quaternion {
        // Half a turn about its first axis.
        let [w, x, y, z] = *q;
        *q = [-x, w, z, -y];
    }
    let (front, back) = (draw(&gpu, &front).1, draw(&gpu, &back).1);
    for i in 0..64 * 48 {
        let off = glam::Vec3::from(front.normal[i]) - glam::Vec3::from(back.normal[i]);
        assert!(off.length() < 1e-5, "pixel {i}");
        assert!(
            (front.median_depth[i] / back.median_depth[i] - 1.0).abs() < 1e-6,
            "pixel {i}"
        );
    }
}

#[test]
fn where_little_is_there_is_no_surface() {
    let gpu = device::gpu();
    let mut scene = stage(64, 48);
    let nothing = |found: &Surface| {
        let depths = found.expected_depth.iter().chain(&found.median_depth);
        depths.chain(found.normal.as_flattened()).all(|x| x.is_nan())
    };
    assert!(nothing(&draw(&gpu, &scene).1), "an empty scene has a surface");
    let faint = Disc {
        pixel: [20.0, 20.0],
        depth: 3.0,
        normal: DVec3::Z,
        sigma: 1.0,
        // Alphas up to 0.475.
        logit: -0.1,
    };
    place(&mut scene, &faint);
    assert!(nothing(&draw(&gpu, &scene).1), "a faint splat has a surface");
    // Two of them cover more than half.
    place(&mut scene, &Disc { depth: 6.0, ..faint });
    let (image, found) = draw(&gpu, &scene);
    let mut seen = 0;
    for (i, &transmittance) in image.transmittance.iter().enumerate() {
        let depth = found.expected_depth[i];
        assert_eq!(transmittance > 0.5, depth.is_nan(), "pixel {i}");
        if !depth.is_nan() {
            seen += 1;
            assert!((3.0..6.0).contains(&depth) && (found.median_depth[i] - 6.0).abs() < 1e-4);
        }
    }
    assert!(seen > 50, "{seen} pixels");
}

#[test]
fn a_ball_before_a_wall_has_a_sharp_border_in_the_median() {
    let gpu = device::gpu();
    let mut scene = stage(96, 72);
    for i in 0..56 * 44 {
        let pixel = [f64::from(i % 56) * 2.0 - 8.0, f64::from(i / 56) * 2.0 - 8.0];
        let disc = |depth: f64| Disc {
            pixel,
            depth,
            normal: DVec3::Z,
            sigma: depth * 0.02,
            logit: 4.0,
        };
        place(&mut scene, &disc(10.0));
        if (pixel[0] - 40.0).hypot(pixel[1] - 36.0) < 20.0 {
            place(&mut scene, &disc(4.0));
        }
    }
    let (_, found) = draw(&gpu, &scene);
    let between = |depths: &[f32]| depths.iter().filter(|z| (4.2..9.5).contains(*z)).count();
    let pixels = found.median_depth.len();
    let (median, expected) = (between(&found.median_depth), between(&found.expected_depth));
    println!("between the surfaces: {median} medians and {expected} means of {pixels} pixels");
    assert!(median * 200 <= pixels, "{median} medians between");
    assert!(expected > 100, "{expected} means between: the scene has no border");
    let near = found.median_depth.iter().filter(|z| **z < 4.2).count();
    assert!(near > 1_000, "{near} pixels of the ball");
}

#[test]
fn the_rules_of_the_3dgs_code_have_no_surface() {
    let gpu = device::gpu();
    let options = RenderOptions {
        compatibility: Compatibility::Inria,
        capacity: Capacity::LEAST,
        ..WITH_SURFACE()
    };
    let error = Renderer::new(&gpu, options).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }), "{error}");
}
