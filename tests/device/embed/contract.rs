//! The contract after an error: the command buffer can be submitted, the image is in its state `after`, and the next
//! picture is right.

use crate::embed::frame::{CLEARED, COPYABLE, Frame};
use crate::embed::host::Host;
use crate::embed::{SIZE, adopt, assert_same, expected, scene, view, watch, wrap};
use ash::vk;
use ashfall::render::{Capacity, Model, Precision, RenderOptions, Renderer};
use ashfall::scene::{Camera, Splats};

const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;

/// Fails every creation of a first picture, one after the other, and draws the picture again each time. The host's copy
/// after the error has no barrier of its own, so that validation would report a wrong state of the image.
#[test]
fn after_a_failed_creation_the_frame_is_submitted_and_the_next_is_right() {
    let scene = scene();
    let expected = expected(&scene, 1).remove(0);
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut failures = 0;
    loop {
        let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
        renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
        frame.begin();
        watch::fail_creation(failures + 1);
        let target = frame.target(CLEARED, COPYABLE);
        let drawn = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), &target);
        let has_failed = watch::creations_left() == 0;
        watch::fail_creation(0);
        assert_eq!(drawn.is_err(), has_failed, "{drawn:?}");
        frame.submit();
        frame.pixels::<f32>();
        assert_eq!(host.messages(), Vec::<String>::new(), "creation {failures}");
        if !has_failed {
            assert_same(&frame.pixels(), &expected);
            break;
        }
        failures += 1;
        frame.begin();
        let next = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), &target);
        assert_eq!(next.unwrap(), None);
        frame.submit();
        assert_same(&frame.pixels(), &expected);
    }
    // Pools, sets, and the memory of uploads and counts.
    assert!(failures > 5, "{failures} creations");
}

/// An upload whose memory fails leaves commands that can be submitted. It may succeed with memory of another type.
#[test]
fn after_a_failed_upload_the_frame_is_submitted() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, false, true);
    let (mut creations, mut refusals) = (0, 0);
    loop {
        let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
        frame.begin();
        watch::fail_creation(creations + 1);
        let model = renderer.record_upload(&mut wrap(&frame), &scene.splats);
        let has_failed = watch::creations_left() == 0;
        watch::fail_creation(0);
        assert!(has_failed || model.is_ok());
        refusals += u32::from(model.is_err());
        frame.hand_over();
        frame.submit();
        frame.pixels::<f32>();
        if !has_failed {
            break;
        }
        creations += 1;
    }
    assert!(refusals > 1, "{refusals} of {creations} creations");
}

/// Every refusal names its cause, and hands the image over.
#[test]
fn refused_pictures_hand_the_image_over() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let half = Model::upload_as(&gpu, &scene.splats, Precision::Half).unwrap();
    let many = Splats {
        mean: scene.splats.mean.repeat(2),
        quaternion: scene.splats.quaternion.repeat(2),
        log_scale: scene.splats.log_scale.repeat(2),
        opacity_logit: scene.splats.opacity_logit.repeat(2),
        sh: scene.splats.sh.repeat(2),
        ..scene.splats.clone()
    };
    let many = Model::upload(&gpu, &many).unwrap();
    let options = RenderOptions {
        capacity: Capacity::for_image(model.splat_count, 1 << 16, SIZE[0], SIZE[1]),
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    let elsewhere = Model::upload(&crate::common::device::gpu(), &scene.splats).unwrap();
    let mut refused = |model: &Model, camera: &Camera, format, extent| {
        frame.begin();
        let target = frame.target_as(format, extent, CLEARED, COPYABLE);
        let result = renderer.record(&mut wrap(&frame), model, camera, &view(&scene), &target);
        frame.submit();
        let red = [1.0, 0.0, 0.0, 1.0];
        assert!(
            frame.pixels::<f32>().iter().all(|p| *p == red),
            "a refused picture was drawn"
        );
        assert_eq!(host.messages(), Vec::<String>::new());
        result.unwrap_err().to_string()
    };
    let camera = scene.camera;
    let refusal = refused(&model, &camera, FORMAT, [SIZE[1], SIZE[0]]);
    assert!(
        refusal.contains("72x50 pixels, the image to draw to 50x72"),
        "{refusal}"
    );
    let refusal = refused(&many, &camera, FORMAT, SIZE);
    assert!(refusal.contains("call reserve first"), "{refusal}");
    let refusal = refused(&half, &camera, FORMAT, SIZE);
    assert!(refusal.contains("Half"), "{refusal}");
    let refusal = refused(&elsewhere, &camera, FORMAT, SIZE);
    assert!(refusal.contains("another device"), "{refusal}");
    let refusal = refused(&model, &camera, vk::Format::R8G8B8A8_SRGB, SIZE);
    assert!(refusal.contains("R8G8B8A8_SRGB"), "{refusal}");
}
