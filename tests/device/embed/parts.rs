//! Pictures in rectangles and layers of a host's images.

use crate::embed::depth::DepthImage;
use crate::embed::frame::{CLEARED, COPYABLE, Frame};
use crate::embed::host::Host;
use crate::embed::words::WordImage;
use crate::embed::{SIZE, adopt, expected, moved, occlusion, scene, view, wrap};
use ash::vk;
use ashfall::gpu::ImageState;
use ashfall::render::{
    Blend, DepthCode, HostDepth, HostTarget, Model, PickArea, RenderOptions, RenderedImage, Renderer,
};

const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
/// Extent of the images.
const LARGE: [u32; 2] = [2 * SIZE[0] + 9, SIZE[1] + 7];
/// First pixels of two pictures side by side.
const ORIGINS: [[u32; 2]; 2] = [[5, 3], [SIZE[0] + 6, 4]];
const RED: [f32; 4] = [1.0, 0.0, 0.0, 1.0];
/// State between two pictures.
const BETWEEN: ImageState = ImageState {
    layout: vk::ImageLayout::GENERAL,
    stage: vk::PipelineStageFlags2::COMPUTE_SHADER,
    access: vk::AccessFlags2::SHADER_STORAGE_WRITE,
};

/// Values of an image: those of pictures from [`ORIGINS`] on, and a value around them.
fn around<T: Copy>(pictures: [&[T]; 2], value: T) -> Vec<T> {
    let mut all = vec![value; (LARGE[0] * LARGE[1]) as usize];
    for ([x, y], picture) in ORIGINS.into_iter().zip(pictures) {
        for (row, values) in (y..).zip(picture.chunks(SIZE[0] as usize)) {
            let first = (row * LARGE[0] + x) as usize;
            all[first..first + values.len()].copy_from_slice(values);
        }
    }
    all
}

fn pixels(image: &RenderedImage) -> Vec<[f32; 4]> {
    let pixels = image.rgb.iter().zip(&image.transmittance);
    pixels.map(|([r, g, b], t)| [*r, *g, *b, 1.0 - t]).collect()
}

/// Two pictures side by side, behind surfaces of the host, have the pixels, splats, depths and reports of pictures of
/// their own; pixels around them are kept.
#[test]
fn pictures_take_rectangles_of_all_images() {
    let scene = scene();
    let host = Host::new();
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let options = RenderOptions {
        with_ids: true,
        with_host_depth: true,
        with_host_color: true,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(&gpu, options).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let (nearest, farthest) = occlusion::depths(&scene);
    // Surfaces by picture, and none around.
    let slope = |at: usize| {
        let x = (at % SIZE[0] as usize) as f64 / f64::from(SIZE[0]);
        nearest + (farthest - nearest) * x
    };
    let surfaces: Vec<f64> = (0..(SIZE[0] * SIZE[1]) as usize).map(slope).collect();
    let turned: Vec<f64> = surfaces.iter().rev().copied().collect();
    let surfaces = [surfaces, turned];

    let mut draw = |extent: [u32; 2], depths: &[f64], origins: &[(usize, Option<[u32; 2]>)], blend: Blend| {
        let frame = Frame::new(&host, FORMAT, extent);
        let (depth, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, extent, depths);
        let [ids, out] = [vk::Format::R32_UINT, vk::Format::D32_SFLOAT].map(|f| WordImage::new(&host, f, extent));
        frame.begin();
        depth.upload(frame.commands);
        let mut commands = wrap(&frame);
        let last = origins.len() - 1;
        for (at, &(picture, origin)) in origins.iter().enumerate() {
            let before = if at == 0 { CLEARED } else { BETWEEN };
            let color = frame.target(before, if at == last { COPYABLE } else { BETWEEN });
            let source = if at == 0 { depth.source() } else { depth.again() };
            let (ids_out, depth_out) = match at {
                0 => (ids.target(), out.target()),
                _ => (ids.again(), out.again()),
            };
            let code = DepthCode::DISTANCE;
            let target = HostTarget {
                blend,
                depth: Some(HostDepth { image: &source, code }),
                ids: Some(&ids_out),
                depth_out: Some(HostDepth {
                    image: &depth_out,
                    code,
                }),
                pick: Some(PickArea {
                    x: 20,
                    y: 30,
                    width: 3,
                    height: 2,
                }),
                origin,
                ..HostTarget::from(&color)
            };
            let camera = moved(&scene.camera, picture);
            renderer
                .record(&mut commands, &model, &camera, &view(&scene), target)
                .unwrap();
        }
        ids.download(frame.commands);
        out.download(frame.commands);
        frame.submit();
        let pixels = frame.pixels::<f32>();
        (pixels, ids.words::<u32>(), out.words::<f32>())
    };
    for blend in [Blend::Replace, Blend::OverDisplay] {
        let alone = [0, 1].map(|at| draw(SIZE, &surfaces[at], &[(at, None)], blend));
        let depths = around([&surfaces[0], &surfaces[1]], f64::INFINITY);
        let both = draw(LARGE, &depths, &[(0, Some(ORIGINS[0])), (1, Some(ORIGINS[1]))], blend);
        assert!(both.0 == around([&alone[0].0, &alone[1].0], RED), "{blend:?}: pixels");
        // Undefined around the pictures.
        let inside = around([&[true; (SIZE[0] * SIZE[1]) as usize]; 2].map(|all| &all[..]), false);
        let (ids, out) = (
            around([&alone[0].1, &alone[1].1], 0),
            around([&alone[0].2, &alone[1].2], 0.0),
        );
        for (at, _) in inside.iter().enumerate().filter(|(_, inside)| **inside) {
            assert_eq!(
                (both.1[at], both.2[at].to_bits()),
                (ids[at], out[at].to_bits()),
                "{blend:?}: {at}"
            );
        }
    }
    assert_eq!(host.messages(), Vec::<String>::new());
}

/// Two eyes in the layers of an image have the pixels of pictures of their own; a layer that is not drawn is kept.
#[test]
fn eyes_take_layers_of_an_image() {
    let scene = scene();
    let expected = expected(&scene, 2);
    let host = Host::new();
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let frame = Frame::with_layers(&host, FORMAT, SIZE, 3);
    frame.begin();
    let mut commands = wrap(&frame);
    for (eye, layer) in [(0, 2), (1, 0)] {
        let target = frame.layer(layer, CLEARED, COPYABLE);
        let camera = moved(&scene.camera, eye);
        renderer
            .record(&mut commands, &model, &camera, &view(&scene), &target)
            .unwrap();
    }
    commands.pass(&gpu, &frame.layer(1, CLEARED, COPYABLE));
    frame.submit();
    let found = frame.pixels::<f32>();
    let layers: Vec<_> = found.chunks((SIZE[0] * SIZE[1]) as usize).collect();
    assert!(layers[0] == pixels(&expected[1]) && layers[2] == pixels(&expected[0]));
    assert!(layers[1].iter().all(|pixel| *pixel == RED));
    assert_eq!(host.messages(), Vec::<String>::new());
}

/// Pictures beyond the images, and smaller ones without an origin, are refused.
#[test]
fn rectangles_beyond_the_images_are_refused() {
    let scene = scene();
    let host = Host::new();
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let frame = Frame::new(&host, FORMAT, LARGE);
    frame.begin();
    for (origin, text) in [
        (None, "the camera has 72x50 pixels, the image to draw to 153x57"),
        (
            Some([81, 8]),
            "72x50 pixels of the camera from (81, 8) on exceed the 153x57",
        ),
        (Some([82, 7]), "from (82, 7) on exceed"),
        (Some([u32::MAX, 0]), "exceed"),
    ] {
        let color = frame.target(CLEARED, CLEARED);
        let target = HostTarget {
            origin,
            ..HostTarget::from(&color)
        };
        let refused = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), target);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains(text), "{refused}");
    }
    let color = frame.target(CLEARED, COPYABLE);
    let target = HostTarget {
        origin: Some([81, 7]),
        ..HostTarget::from(&color)
    };
    let mut commands = wrap(&frame);
    renderer
        .record(&mut commands, &model, &scene.camera, &view(&scene), target)
        .unwrap();
    frame.submit();
    assert_eq!(host.messages(), Vec::<String>::new());
}
