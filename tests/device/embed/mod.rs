//! The engine on a host's device: it only records.

mod blending;
mod contract;
mod depth;
mod economy;
mod foreign;
mod frame;
mod heap;
mod host;
mod instances;
mod occlusion;
mod parts;
mod picking;
mod requirements;
mod texels;
mod watch;
mod words;

use crate::common::scenes::Scene;
use ash::vk;
use ashfall::gpu::{Gpu, HostCommands, REQUIRED};
use ashfall::kernels::{BASELINES, KERNELS};
use ashfall::lab::synth;
use ashfall::render::{Capacity, Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use ashfall::scene::Camera;
use ashfall::shader::{BindingKind, Requirement};
use ashfall::train::{TrainConfig, Trainer};
use frame::{CLEARED, COPYABLE, Frame};
use glam::DVec3;
use host::Host;

const SIZE: [u32; 2] = [72, 50];

fn scene() -> Scene {
    crate::common::scenes::gentle(5, 80, SIZE[0], SIZE[1], 2)
}

fn view(scene: &Scene) -> ViewOptions {
    ViewOptions {
        background: [0.25, 0.5, 0.75],
        near: scene.options.near as f32,
        filter: scene.splats.filter,
    }
}

/// Camera of a frame: shifted by a constant step per frame.
fn moved(camera: &Camera, frame: usize) -> Camera {
    Camera {
        position: camera.position + DVec3::new(0.0625, -0.03125, 0.0) * frame as f64,
        ..*camera
    }
}

/// Frames drawn on a device of the engine's own.
fn expected(scene: &Scene, frames: usize) -> Vec<RenderedImage> {
    let gpu = crate::common::device::gpu();
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let cameras = (0..frames).map(|frame| moved(&scene.camera, frame));
    cameras
        .map(|camera| renderer.render(&model, &camera, &view(scene)).unwrap())
        .collect()
}

fn adopt(host: &Host, with_queue: bool, with_allocator: bool) -> Gpu {
    // SAFETY: the host has enabled the required features, and outlives the engine.
    unsafe { Gpu::adopt(host.introduce(with_queue, with_allocator)) }.unwrap()
}

fn wrap(frame: &Frame<'_>) -> HostCommands {
    // SAFETY: the frame is being recorded; it is waited for before it is reused.
    unsafe { HostCommands::wrap(frame.commands) }
}

fn assert_same(pixels: &[[f32; 4]], expected: &RenderedImage) {
    for (i, pixel) in pixels.iter().enumerate() {
        let [r, g, b] = expected.rgb[i];
        assert_eq!(*pixel, [r, g, b, 1.0 - expected.transmittance[i]], "pixel {i}");
    }
}

/// Asserts at most the rounding of a store to 8 bits per channel: Vulkan permits either of the two nearest levels.
fn assert_near(pixels: &[[u8; 4]], expected: &RenderedImage) {
    for (i, pixel) in pixels.iter().enumerate() {
        let [r, g, b] = expected.rgb[i];
        let exact = [r, g, b, 1.0 - expected.transmittance[i]];
        for (level, value) in pixel.iter().zip(exact) {
            let off = (f32::from(*level) - 255.0 * value.clamp(0.0, 1.0)).abs();
            assert!(off <= 1.01, "pixel {i}: {pixel:?} for {exact:?}");
        }
    }
}

/// One picture with the given sources of queue and memory.
fn draw_once(with_queue: bool, with_allocator: bool, format: vk::Format) {
    let scene = scene();
    let expected = expected(&scene, 1).remove(0);
    let host = Host::new();
    let frame = Frame::new(&host, format, SIZE);
    let gpu = adopt(&host, with_queue, with_allocator);
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let uploaded = Model::upload(&gpu, &scene.splats);
    frame.begin();
    let mut commands = wrap(&frame);
    let model = if with_queue {
        uploaded.unwrap()
    } else {
        let refused = uploaded.unwrap_err().to_string();
        assert!(refused.contains("without a queue"), "{refused}");
        renderer.record_upload(&mut commands, &scene.splats).unwrap()
    };
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    watch::calls();
    let target = frame.target(CLEARED, COPYABLE);
    let stats = renderer
        .record(&mut commands, &model, &scene.camera, &view(&scene), &target)
        .unwrap();
    assert_eq!(stats, None);
    let calls = watch::calls();
    assert!(
        !calls
            .iter()
            .any(|call| call.contains("Submit") || call.contains("Wait")),
        "{calls:?}"
    );
    frame.submit();
    if format == vk::Format::R8G8B8A8_UNORM {
        assert_near(&frame.pixels(), &expected);
    } else {
        assert_same(&frame.pixels(), &expected);
    }
    drop((renderer, model, gpu));
    // The host's objects are still usable.
    frame.begin();
    frame.hand_over();
    frame.submit();
    if format == vk::Format::R8G8B8A8_UNORM {
        assert!(frame.pixels().iter().all(|p: &[u8; 4]| *p == [255, 0, 0, 255]));
    }
}

#[test]
fn a_guest_with_the_hosts_queue_and_memory_draws_the_same_picture() {
    draw_once(true, true, vk::Format::R32G32B32A32_SFLOAT);
}

#[test]
fn a_guest_with_memory_of_its_own_draws_the_same_picture() {
    draw_once(true, false, vk::Format::R8G8B8A8_UNORM);
}

#[test]
fn a_guest_without_a_queue_draws_the_same_picture() {
    draw_once(false, true, vk::Format::R8G8B8A8_UNORM);
    draw_once(false, false, vk::Format::R32G32B32A32_SFLOAT);
}

#[test]
fn frames_in_flight_report_what_did_not_fit_and_allocate_nothing_once_warm() {
    let scene = scene();
    let expected = expected(&scene, 8);
    let host = Host::new();
    let frames = [0, 1].map(|_| Frame::new(&host, vk::Format::R32G32B32A32_SFLOAT, SIZE));
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let capacity = Capacity::for_image(model.splat_count, 16, SIZE[0], SIZE[1]);
    let options = RenderOptions {
        frames_in_flight: 2,
        capacity,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    renderer.prepare(&model).unwrap();
    for (i, expected) in expected.iter().enumerate() {
        let frame = &frames[i % 2];
        frame.begin();
        let camera = moved(&scene.camera, i);
        let (target, view) = (frame.target(CLEARED, COPYABLE), view(&scene));
        watch::calls();
        let allocations = heap::allocations();
        let stats = renderer.record(&mut wrap(frame), &model, &camera, &view, &target);
        let allocations = heap::allocations() - allocations;
        let calls = watch::calls();
        let stats = stats.unwrap();
        match i {
            0 | 1 => assert_eq!(stats, None),
            // Frame 2 has the count of frame 0, which did not fit: it draws in bands.
            2..=4 => assert_eq!(
                stats.map(|s| (s.isect_capacity, s.bands > 1, s.complete)),
                Some((72, i == 4, i == 4))
            ),
            _ => {
                assert!(
                    stats.is_some_and(|s| s.fits() && s.complete && s.isects > 72),
                    "{stats:?}"
                );
                assert_eq!(calls, Vec::<&str>::new(), "frame {i} is not the first");
                assert_eq!(allocations, 0, "frame {i} is not the first");
            }
        }
        frame.submit();
        let pixels = || frame.pixels::<f32>();
        // Frame 2 reports the overflow of frame 0.
        match stats {
            Some(stats) if i == 2 => renderer.reserve(&model, &camera, 2 * stats.isects).unwrap(),
            _ => {}
        }
        if i < 2 {
            assert!(pixels().iter().all(|p| *p == [0.25, 0.5, 0.75, 0.0]), "frame {i}");
        } else if i % 2 == 1 || i == 2 {
            // Every other frame is still in flight while the next is recorded.
            assert_same(&pixels(), expected);
        }
    }
}

#[test]
fn two_pictures_share_a_frame_and_our_own_rendering_does_not_disturb_them() {
    let scene = scene();
    let expected = expected(&scene, 3);
    let host = Host::new();
    let frames = [0, 1].map(|_| Frame::new(&host, vk::Format::R32G32B32A32_SFLOAT, SIZE));
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let options = RenderOptions {
        frames_in_flight: 1,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let [left, right] = &frames;
    for round in 0..2 {
        left.begin();
        right.make_copyable();
        let mut commands = wrap(left);
        for (i, frame) in frames.iter().enumerate() {
            let before = if i == 0 { CLEARED } else { COPYABLE };
            let target = frame.target(before, COPYABLE);
            let camera = moved(&scene.camera, i);
            let stats = renderer
                .record(&mut commands, &model, &camera, &view(&scene), &target)
                .unwrap();
            assert_eq!(stats.is_some(), round == 1 && i == 0);
        }
        left.submit();
        let ours = renderer
            .render(&model, &moved(&scene.camera, 2), &view(&scene))
            .unwrap();
        assert_eq!(ours.rgb, expected[2].rgb);
        assert_same(&left.pixels(), &expected[0]);
        right.resubmit();
        assert_same(&right.pixels(), &expected[1]);
    }
}

/// Training submits by itself, to the queue lent by the host.
#[test]
fn a_guest_with_a_queue_trains_to_the_same_bits() {
    let dataset = synth::scene(synth::Kind::Sphere).dataset(&synth::SynthOptions {
        views: 4,
        width: 40,
        height: 30,
        samples: 1,
        points: 200,
        ..synth::SynthOptions::default()
    });
    let train = |gpu: &Gpu| {
        let config = TrainConfig::for_iterations(3);
        let mut trainer = Trainer::new(gpu, &dataset, config).unwrap();
        while !trainer.is_done() {
            trainer.step().unwrap();
        }
        trainer.splats().unwrap()
    };
    let host = Host::new();
    let gpu = adopt(&host, true, true);
    assert_eq!(train(&gpu), train(&crate::common::device::whole()));
}

/// Negative check of the validation: a wrong image state is reported.
#[test]
fn a_lie_about_the_images_state_is_noticed() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, vk::Format::R8G8B8A8_UNORM, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    frame.begin();
    assert_eq!(host.messages(), Vec::<String>::new());
    let lie = ashfall::gpu::ImageState {
        layout: vk::ImageLayout::GENERAL,
        ..CLEARED
    };
    let target = frame.target(lie, COPYABLE);
    renderer
        .record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), &target)
        .unwrap();
    frame.submit();
    frame.pixels::<u8>();
    assert!(host.messages().iter().any(|m| m.contains("oldLayout")));
}

#[test]
fn what_is_published_covers_every_kernel() {
    for kernel in KERNELS {
        let of_kind = |kind| kernel.bindings.iter().filter(|b| b.kind == kind).count() as u32;
        let buffers = of_kind(BindingKind::Buffer);
        assert!(buffers <= REQUIRED.storage_buffers, "{}: {buffers}", kernel.kernel);
        assert!(kernel.params_size <= REQUIRED.push_constant_bytes);
        let is_base = kernel.variant.is_empty() && !BASELINES.contains(&kernel.kernel);
        let is_free = |need: &Requirement| *need == Requirement::SubgroupBasic;
        assert!(!is_base || kernel.requirements.iter().all(is_free), "{}", kernel.kernel);
    }
}
