//! Frames and steps that exceed the range of one binding or the capacity of buffers: the same bits, in more passes.

use crate::common::scenes::{Scene, photographed};
use ashfall::gpu::Gpu;
use ashfall::reference;
use ashfall::render::{Capacity, Model, RenderOptions, RenderedImage, Renderer, Surface, ViewOptions};
use ashfall::scene::{Dataset, Point};
use ashfall::train::{HostState, TrainConfig, Trainer};

/// Smallest range of a binding for these tests, bytes: that of their images.
const NARROW: u64 = 32 << 10;

fn render(gpu: &Gpu, scene: &Scene) -> RenderedImage {
    let options = RenderOptions {
        capacity: Capacity {
            splats: 1,
            isects: 1,
            pixels: 1,
            tiles: 1,
        },
        with_depth: true,
        with_surface: true,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(gpu, options).unwrap();
    let model = Model::upload(gpu, &scene.splats).unwrap();
    let view = ViewOptions {
        background: scene.options.background.map(|c| c as f32),
        near: scene.options.near as f32,
        filter: scene.splats.filter,
    };
    renderer.render(&model, &scene.camera, &view).unwrap()
}

fn surface(image: &RenderedImage) -> &Surface {
    image.surface.as_ref().unwrap()
}

fn bits(image: &RenderedImage) -> Vec<u32> {
    let values = image.rgb.iter().flatten().chain(&image.transmittance);
    let surface = surface(image);
    let depths = surface.expected_depth.iter().chain(&surface.median_depth);
    let surface = depths.chain(surface.normal.as_flattened());
    values.chain(&image.depth).chain(surface).map(|x| x.to_bits()).collect()
}

/// Largest error against the oracle over pixels far from any discontinuity.
fn error(scene: &Scene, image: &RenderedImage) -> f64 {
    let expected = reference::frame::render(&scene.splats, &scene.camera, &scene.options);
    let margins = reference::frame::discontinuity_margins(&scene.splats, &scene.camera, &scene.options);
    let pixels = expected.pixels.iter().zip(&margins).enumerate();
    let sound = pixels.filter(|(_, (_, margin))| margin.nearest() > 1e-4);
    sound
        .flat_map(|(i, (pixel, _))| [0, 1, 2].map(|c| (f64::from(image.rgb[i][c]) - pixel.color[c]).abs()))
        .fold(0.0, f64::max)
}

/// Splats all over a small image, many of them wide: more intersections than a narrow binding holds.
fn dense(seed: u64, splats: usize) -> Scene {
    let mut scene = crate::common::scenes::gentle(seed, splats, 43, 37, 3);
    for scale in scene.splats.log_scale.iter_mut().flatten() {
        *scale += 1.5;
    }
    for logit in &mut scene.splats.opacity_logit {
        *logit -= 3.0;
    }
    scene
}

#[test]
fn a_scene_of_many_blocks_and_bands_is_drawn_as_one() {
    let (wide, narrow) = (crate::common::device::gpu(), crate::common::device::narrow(NARROW));
    for (name, scene) in [
        ("nothing", crate::common::scenes::gentle(1, 0, 43, 37, 3)),
        ("one", crate::common::scenes::gentle(1, 1, 43, 37, 3)),
        ("gentle", crate::common::scenes::gentle(1, 900, 43, 37, 3)),
        ("hard", crate::common::scenes::hard(2, 900, 43, 37, 2)),
        ("dense", dense(3, 1500)),
    ] {
        let model = Model::upload(&narrow, &scene.splats).unwrap();
        assert_eq!(model.params.len() > 1, scene.splats.len() > 128, "{name}");
        let image = render(&narrow, &scene);
        assert!(bits(&image) == bits(&render(&wide, &scene)), "{name}: other bits");
        let surfaces = surface(&image).median_depth.iter().filter(|z| z.is_finite()).count();
        assert_eq!(
            surfaces > 100,
            scene.splats.len() > 1,
            "{name}: {surfaces} pixels with a surface"
        );
        let error = error(&scene, &image);
        println!("{name}: {error:.1e}");
        // The tolerances of frame.rs for gentle and hard scenes.
        assert!(error <= if name == "hard" { 1e-3 } else { 1e-4 }, "{name}: {error}");
    }
}

#[test]
fn a_frame_is_complete_though_memory_ends() {
    let scene = dense(4, 1500);
    let wide = crate::common::device::gpu();
    let image = bits(&render(&wide, &scene));
    // Less memory than growing to all intersections at once took.
    let tight = crate::common::device::limited(Some(wide.memory_peak() - 200_000));
    assert!(bits(&render(&tight, &scene)) == image, "other bits");
}

#[test]
fn a_list_longer_than_a_driver_runs_loops_is_drawn_whole() {
    // One tile with more splats than a software device's loop limit, each too small and faint to affect more than one
    // pixel: the image is not opaque before the last.
    let mut scene = crate::common::scenes::gentle(5, 130_000, 8, 16, 0);
    for logit in &mut scene.splats.opacity_logit {
        *logit = -5.28;
    }
    for scale in scene.splats.log_scale.iter_mut().flatten() {
        *scale = -9.0;
    }
    let gpu = crate::common::device::gpu();
    let image = render(&gpu, &scene);
    let expected = reference::frame::render(&scene.splats, &scene.camera, &scene.options);
    let (mut most, mut least) = (0.0f64, 1.0f64);
    for (i, pixel) in expected.pixels.iter().enumerate() {
        least = least.min(pixel.transmittance);
        most = most.max((f64::from(image.transmittance[i]) - pixel.transmittance).abs());
    }
    println!("transmittance from {least:.3}, error {most:.1e}");
    assert!(least > 0.01 && least < 0.5, "{least}");
    // The tolerance of frame.rs; a lost splat would cost 1/255 of the transmittance.
    assert!(most <= 1e-4, "{most}");
}

/// A data set of one generated photograph of a scene.
fn dataset(scene: &Scene) -> Dataset {
    let camera = scene.camera;
    let ahead = camera.position + camera.rotation.row(2) * 4.0;
    Dataset {
        views: vec![photographed(camera, |_| 255)],
        points: vec![Point {
            position: ahead.to_array(),
            color: [0.5; 3],
        }],
        ..Dataset::default()
    }
}

/// Result of a few steps.
struct Trained {
    state: HostState,
    statistics: Vec<[f32; 4]>,
    losses: Vec<f64>,
    /// Most intersections of a frame.
    isects: usize,
}

fn train(gpu: &Gpu, scene: &Scene, steps: usize) -> Trained {
    let dataset = dataset(scene);
    let mut config = TrainConfig::for_iterations(1_000);
    config.sh_degree = scene.splats.sh_degree;
    config.sh_degree_from = [0; 3];
    let state = HostState::from_splats(&scene.splats, config.sh_degree);
    let mut trainer = Trainer::from_state(gpu, &dataset, config, &state, 0).unwrap();
    let mut reports = Vec::new();
    // A step that did not fit is undone.
    while reports.len() < steps {
        match trainer.iteration() < steps as u32 {
            true => reports.extend(trainer.step().unwrap()),
            false => reports.extend(trainer.finish().unwrap()),
        }
    }
    assert!(reports.iter().all(|report| report.poisoned == 0), "{reports:?}");
    Trained {
        losses: reports.iter().map(|report| report.loss).collect(),
        isects: trainer.extremes().isects,
        statistics: trainer.statistics().unwrap(),
        state: trainer.download().unwrap(),
    }
}

/// Smallest range of a binding for these tests, bytes: 36 bytes a pixel for the derivatives of SSIM.
const NARROW_TRAINING: u64 = 64 << 10;

#[test]
fn a_scene_of_many_blocks_and_bands_is_trained_as_one() {
    let (wide, narrow) = (
        crate::common::device::gpu(),
        crate::common::device::narrow(NARROW_TRAINING),
    );
    for (name, scene) in [
        ("one", crate::common::scenes::gentle(1, 1, 43, 37, 3)),
        ("blocks", crate::common::scenes::gentle(1, 300, 43, 37, 3)),
        ("hard", crate::common::scenes::hard(2, 900, 43, 37, 2)),
        ("margins", dense(3, 1500)),
    ] {
        let (found, expected) = (train(&narrow, &scene, 4), train(&wide, &scene, 4));
        assert_eq!(found.losses, expected.losses, "{name}: other losses");
        assert!(found.statistics == expected.statistics, "{name}: other statistics");
        assert!(found.state == expected.state, "{name}: other bytes");
        let splats = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
        // 16 bytes per intersection in the widest array.
        let is_banded = found.isects as u64 > NARROW_TRAINING / 16;
        let wanted = ["hard", "margins"].contains(&name);
        assert_eq!(is_banded, wanted, "{name}: {}", found.isects);
        assert!(found.state.params != splats.params, "{name}: nothing learnt");
    }
}

#[test]
fn a_list_longer_than_a_driver_runs_loops_is_trained_whole() {
    // As above: splats that fill many lists, each faint and smaller than a pixel. A software device that left its loops
    // early would leave records unwritten, as NaNs, which are counted.
    let mut scene = crate::common::scenes::gentle(5, 200_000, 8, 16, 0);
    scene.splats.opacity_logit.fill(-5.28);
    scene.splats.log_scale.fill([-9.0; 3]);
    let gpu = crate::common::device::gpu();
    let Trained { state, statistics, .. } = train(&gpu, &scene, 1);
    let seen = statistics.iter().filter(|of| of[1] == 1.0).count();
    let moved = state.m[0].iter().filter(|moment| moment[3] != 0.0).count();
    println!("{seen} splats seen, {moved} with a gradient");
    // More than one list's limit. An alpha of 1/255 is reached within 0.39 px of a splat's centre, half of the pixels'
    // area.
    assert!(seen > 100_000 && moved > seen / 2, "{moved} of {seen}");
}
