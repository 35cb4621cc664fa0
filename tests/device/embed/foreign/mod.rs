//! A host that wgpu is: its device, its textures, its meshes, its command buffers, its submissions.

mod device;
mod meshes;

use crate::common::scenes::Scene;
use crate::embed::depth::DepthImage;
use crate::embed::frame::{COPYABLE, Frame, UPLOADED};
use crate::embed::host::Host;
use crate::embed::occlusion::depths;
use crate::embed::{SIZE, adopt, assert_same, expected, moved, scene, view, wrap};
use ash::vk;
use ashfall::gpu::HostImage;
use ashfall::render::{Blend, DepthCode, HostDepth, HostTarget, Model, RenderOptions, Renderer};
use device::WgpuHost;
use meshes::{MeshTarget, NEAR, SHARED, pipeline};

const IN_FLIGHT: usize = 3;
const FRAMES: usize = 300;
/// Camera positions, which the frames take in turn.
const PLACES: usize = 8;

const CODE: DepthCode = DepthCode {
    a: 0.0,
    b: NEAR,
    is_linear: false,
    empty: 0.0,
};

fn options() -> RenderOptions {
    RenderOptions {
        with_host_color: true,
        with_host_depth: true,
        frames_in_flight: IN_FLIGHT,
        ..RenderOptions::default()
    }
}

fn over<'a>(color: &'a HostImage, depth: &'a HostImage) -> HostTarget<'a> {
    HostTarget {
        blend: Blend::OverDisplay,
        depth: Some(HostDepth {
            image: depth,
            code: CODE,
        }),
        ..HostTarget::from(color)
    }
}

/// Splats over these colours and behind these depths, on a device that wgpu has no part in.
fn composited(scene: &Scene, place: usize, below: &[[f32; 4]], stored: &[f32]) -> Vec<[f32; 4]> {
    let host = Host::new();
    let mut frame = Frame::new(&host, vk::Format::R32G32B32A32_SFLOAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, options()).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let stored: Vec<f64> = stored.iter().map(|&depth| depth.into()).collect();
    let (depth, _) = DepthImage::new(&host, vk::Format::D32_SFLOAT, SIZE, &stored);
    frame.begin_over(below);
    depth.upload(frame.commands);
    let (color, depth_source) = (frame.target(UPLOADED, COPYABLE), depth.source());
    let camera = moved(&scene.camera, place);
    let target = over(&color, &depth_source);
    renderer
        .record(&mut wrap(&frame), &model, &camera, &view(scene), target)
        .unwrap();
    frame.submit();
    frame.pixels()
}

/// Colour and depth of wgpu's meshes alone.
fn meshes_alone(host: &WgpuHost, target: &MeshTarget, meshes: &wgpu::RenderPipeline) -> (Vec<[f32; 4]>, Vec<f32>) {
    let mut encoder = host.device.create_command_encoder(&Default::default());
    target.draw(&mut encoder, Some(meshes));
    let [color, depth] = target.copy(host, &mut encoder);
    host.queue.submit([encoder.finish()]);
    (color.pixels(host), depth.pixels(host))
}

/// Bytes in use by guest and host.
fn bytes(host: &WgpuHost, gpu: &ashfall::Gpu) -> (u64, u64) {
    let report = host.device.generate_allocator_report().unwrap();
    (gpu.memory_in_use(), report.total_allocated_bytes)
}

/// Frames of meshes by wgpu and splats among them, three in flight: the bits of the same splats, pixels and depths on a
/// device of our own; memory stays as it is.
#[test]
fn splats_stand_among_the_meshes_of_wgpu() {
    let scene = scene();
    let host = WgpuHost::new();
    let meshes = pipeline(&host, depths(&scene));
    let targets = [(); IN_FLIGHT].map(|()| MeshTarget::new(&host));
    let (below, stored) = meshes_alone(&host, &targets[0], &meshes);
    let gpu = host.adopt();
    let mut renderer = Renderer::new(&gpu, options()).unwrap();
    let mut model: Option<Model> = None;
    let mut submitted: [Option<wgpu::SubmissionIndex>; IN_FLIGHT] = Default::default();
    let (mut warm, mut copies) = (None, Vec::new());
    for i in 0..FRAMES {
        let (target, place) = (&targets[i % IN_FLIGHT], i % PLACES);
        if let Some(before) = submitted[i % IN_FLIGHT].take() {
            host.wait(Some(before));
        }
        if i == 30 {
            warm = Some(bytes(&host, &gpu));
        } else if i + IN_FLIGHT == FRAMES {
            assert_eq!(Some(bytes(&host, &gpu)), warm, "memory after {i} frames");
        }
        let mut before = host.device.create_command_encoder(&Default::default());
        target.draw(&mut before, Some(&meshes));
        target.hand_over(&mut before);
        let [color, depth] = target.images(SHARED);
        let splats = host.guest_commands(|commands| {
            let model = &*model.get_or_insert_with(|| {
                let model = renderer.record_upload(commands, &scene.splats).unwrap();
                renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
                model
            });
            let camera = moved(&scene.camera, place);
            let drawn = renderer.record(commands, model, &camera, &view(&scene), over(&color, &depth));
            assert!(drawn.unwrap().is_none_or(|stats| stats.complete));
        });
        let mut after = host.device.create_command_encoder(&Default::default());
        if i + IN_FLIGHT >= FRAMES {
            copies.push((place, target.copy(&host, &mut after)));
        }
        submitted[i % IN_FLIGHT] = Some(host.queue.submit([before.finish(), splats, after.finish()]));
    }
    for (place, [color, depth]) in &copies {
        let (found, kept) = (color.pixels::<[f32; 4]>(&host), depth.pixels::<f32>(&host));
        assert_eq!(kept, stored, "the guest only reads depths");
        assert_eq!(found, composited(&scene, *place, &below, &stored), "place {place}");
        let free = composited(&scene, *place, &below, &vec![0.0; stored.len()]);
        let count = |is: &dyn Fn(usize) -> bool| (0..found.len()).filter(|&i| is(i)).count();
        let hidden = count(&|i| found[i] != free[i]);
        let shown = count(&|i| stored[i] > 0.0 && found[i] != below[i]);
        assert!(
            hidden > 300 && shown > 300,
            "{hidden} pixels hidden, {shown} shown before meshes"
        );
    }
    drop((renderer, model, gpu, targets, copies, meshes));
    assert_eq!(host.close(), Vec::<String>::new());
}

/// A picture of splats alone in a texture that wgpu has cleared or not, said to be in a layout.
fn splats_alone(host: &WgpuHost, scene: &Scene, is_cleared: bool, layout: vk::ImageLayout) -> Vec<[f32; 4]> {
    let gpu = host.adopt();
    let mut renderer = Renderer::new(&gpu, options()).unwrap();
    let target = MeshTarget::new(host);
    let mut before = host.device.create_command_encoder(&Default::default());
    if is_cleared {
        target.draw(&mut before, None);
    }
    target.hand_over(&mut before);
    let [image, _] = target.images(layout);
    let mut model = None;
    let splats = host.guest_commands(|commands| {
        let uploaded = renderer.record_upload(commands, &scene.splats).unwrap();
        renderer.reserve(&uploaded, &scene.camera, 1 << 16).unwrap();
        let drawn = renderer.record(commands, &uploaded, &scene.camera, &view(scene), &image);
        drawn.unwrap();
        model = Some(uploaded);
    });
    let mut after = host.device.create_command_encoder(&Default::default());
    let [color, _] = target.copy(host, &mut after);
    host.queue.submit([before.finish(), splats, after.finish()]);
    color.pixels(host)
}

/// wgpu clears a texture before it first reads it, unless wgpu itself has written it: a guest's picture is then lost. A
/// host clears its texture once.
#[test]
fn a_texture_that_wgpu_never_wrote_loses_the_guests_picture() {
    let scene = scene();
    let host = WgpuHost::new();
    assert_same(&splats_alone(&host, &scene, true, SHARED), &expected(&scene, 1)[0]);
    let lost = splats_alone(&host, &scene, false, SHARED);
    assert_eq!(lost, vec![[0.0; 4]; lost.len()]);
    assert_eq!(host.close(), Vec::<String>::new());
}

/// Negative check of the messages: a texture in another state than the one stated is reported.
#[test]
fn a_lie_about_wgpus_texture_is_noticed() {
    let scene = scene();
    let host = WgpuHost::new();
    splats_alone(&host, &scene, true, vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL);
    let messages = host.close();
    assert!(
        messages.iter().any(|message| message.contains("InvalidImageLayout")),
        "{messages:?}"
    );
}
