//! Instances in a host's frames: bits of the engine's own device, nothing allocated once warm, refusals before drawing.

use crate::embed::frame::{CLEARED, COPYABLE, Frame};
use crate::embed::host::Host;
use crate::embed::{SIZE, adopt, assert_same, heap, moved, scene, view, watch, wrap};
use ash::vk;
use ashfall::render::{Instance, Model, RenderOptions, Renderer};
use ashfall::scene::Similarity;
use glam::{DMat3, DVec3};

const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

fn two(model: &Model) -> [Instance<'_>; 2] {
    let beside = Instance {
        world_from_model: Similarity {
            rotation: DMat3::from_rotation_z(0.5),
            scale: 0.75,
            translation: DVec3::new(0.25, -0.125, 0.5),
        },
        opacity: 0.5,
        tint: [0.5, 1.0, 0.75],
        ..Instance::new(model)
    };
    [Instance::new(model), beside]
}

#[test]
fn a_guest_draws_instances_and_allocates_nothing_once_warm() {
    let scene = scene();
    let own = crate::common::device::gpu();
    let model = Model::upload(&own, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&own, RenderOptions::default()).unwrap();
    let expected: Vec<_> = (0..5)
        .map(|frame| {
            let camera = moved(&scene.camera, frame);
            renderer.render_instances(&two(&model), &camera, &view(&scene)).unwrap()
        })
        .collect();
    let host = Host::new();
    let frames = [0, 1].map(|_| Frame::new(&host, FORMAT, SIZE));
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let instances = two(&model);
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    renderer.reserve_instances(&instances, &scene.camera, 1 << 16).unwrap();
    for (i, expected) in expected.iter().enumerate() {
        let frame = &frames[i % 2];
        frame.begin();
        let (camera, options) = (moved(&scene.camera, i), view(&scene));
        let (target, mut commands) = (frame.target(CLEARED, COPYABLE), wrap(frame));
        watch::calls();
        let allocations = heap::allocations();
        let stats = renderer.record_instances(&mut commands, &instances, &camera, &options, &target);
        let allocations = heap::allocations() - allocations;
        let calls = watch::calls();
        let stats = stats.unwrap();
        if i > 1 {
            assert!(stats.is_some_and(|stats| stats.complete && stats.fits()), "{stats:?}");
            assert_eq!((calls, allocations), (Vec::new(), 0), "frame {i} is not the first");
        }
        frame.submit();
        assert_same(&frame.pixels(), expected);
    }
}

#[test]
fn refused_instances_hand_the_image_over() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    let refused = |renderer: &mut Renderer, instances: &[Instance<'_>]| {
        frame.begin();
        let target = frame.target(CLEARED, COPYABLE);
        let drawn = renderer.record_instances(&mut wrap(&frame), instances, &scene.camera, &view(&scene), &target);
        frame.submit();
        let red = [1.0, 0.0, 0.0, 1.0];
        assert!(
            frame.pixels::<f32>().iter().all(|p| *p == red),
            "a refused picture was drawn"
        );
        assert_eq!(host.messages(), Vec::<String>::new());
        drawn.unwrap_err().to_string()
    };
    let mut instances = two(&model);
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let refusal = refused(&mut renderer, &instances);
    assert!(refusal.contains("call prepare_instances first"), "{refusal}");
    renderer.prepare_instances(&instances).unwrap();
    let refusal = refused(&mut renderer, &instances);
    assert!(refusal.contains("call reserve first"), "{refusal}");
    renderer.reserve_instances(&instances, &scene.camera, 1 << 16).unwrap();
    instances[1].world_from_model.scale = 0.0;
    let refusal = refused(&mut renderer, &instances);
    assert!(refusal.contains("instance 1: a transform"), "{refusal}");
}
