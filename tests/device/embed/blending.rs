//! Splats over a host's pixels, which are red.

use crate::common::scenes::Scene;
use crate::embed::depth::DepthImage;
use crate::embed::frame::{CLEARED, COPYABLE, Frame};
use crate::embed::host::Host;
use crate::embed::{SIZE, adopt, scene, view, wrap};
use ash::vk;
use ashfall::gpu::{Gpu, ImageState};
use ashfall::reference::overlay::{over_display, over_linear};
use ashfall::render::{
    Blend, DepthCode, HostDepth, HostTarget, Model, RenderOptions, RenderedImage, Renderer, ViewOptions,
};

const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;
const RED: [f64; 4] = [1.0, 0.0, 0.0, 1.0];

fn renderer(gpu: &Gpu, model: &Model, scene: &Scene) -> Renderer {
    let options = RenderOptions {
        with_host_color: true,
        with_host_depth: true,
        ..RenderOptions::default()
    };
    let mut renderer = Renderer::new(gpu, options).unwrap();
    renderer.reserve(model, &scene.camera, 1 << 16).unwrap();
    renderer
}

/// The scene without a background.
fn splats_alone(renderer: &mut Renderer, model: &Model, scene: &Scene) -> RenderedImage {
    let view = ViewOptions {
        background: [0.0; 3],
        ..view(scene)
    };
    renderer.render(model, &scene.camera, &view).unwrap()
}

/// Pixel of the splats by a rule, over red.
fn blended(blend: Blend, splats: &RenderedImage, i: usize) -> [f64; 4] {
    let (color, transmittance) = (splats.rgb[i].map(f64::from), f64::from(splats.transmittance[i]));
    match blend {
        Blend::OverDisplay => over_display(color, transmittance, RED),
        Blend::OverLinear { gain } => over_linear(color, transmittance, RED, gain.into()),
        _ => over_display(color, transmittance, [0.0; 4]),
    }
}

/// Every rule against the reference, on the splats' picture of the same renderer; pixels without splats keep the host's
/// bits.
#[test]
fn splats_are_blended_with_the_hosts_pixels() {
    // Not all pixels have splats.
    let mut scene = scene();
    scene.splats.log_scale.iter_mut().flatten().for_each(|log| *log -= 1.0);
    let host = Host::new();
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = renderer(&gpu, &model, &scene);
    let splats = splats_alone(&mut renderer, &model, &scene);
    let free = splats.transmittance.iter().filter(|&&t| t == 1.0).count();
    assert!(
        free > PIXELS / 10 && free < PIXELS * 9 / 10,
        "{free} of {PIXELS} pixels without splats"
    );
    for format in [vk::Format::R32G32B32A32_SFLOAT, vk::Format::R8G8B8A8_UNORM] {
        let is_float = format == vk::Format::R32G32B32A32_SFLOAT;
        let frame = Frame::new(&host, format, SIZE);
        for blend in [
            Blend::Premultiplied,
            Blend::OverDisplay,
            Blend::OverLinear { gain: 1.0 },
            Blend::OverLinear { gain: 0.25 },
        ] {
            frame.begin();
            let color = frame.target(CLEARED, COPYABLE);
            let target = HostTarget {
                blend,
                ..HostTarget::from(&color)
            };
            let drawn = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), target);
            drawn.unwrap();
            frame.submit();
            let found: Vec<[f64; 4]> = match is_float {
                true => frame.pixels::<f32>().iter().map(|p| p.map(f64::from)).collect(),
                false => frame
                    .pixels::<u8>()
                    .iter()
                    .map(|p| p.map(|c| f64::from(c) / 255.0))
                    .collect(),
            };
            for (i, pixel) in found.iter().enumerate() {
                if splats.transmittance[i] == 1.0 && blend != Blend::Premultiplied {
                    assert_eq!(*pixel, RED, "{blend:?}, pixel {i}");
                }
                let exact = blended(blend, &splats, i);
                for (found, exact) in pixel.iter().zip(exact) {
                    let (exact, bound) = match is_float {
                        true => (exact, 1e-5),
                        // Vulkan permits either of the two nearest levels.
                        false => (exact.clamp(0.0, 1.0), 1.01 / 255.0),
                    };
                    assert!(
                        (found - exact).abs() <= bound,
                        "{format:?}, {blend:?}, pixel {i}: {found} for {exact}"
                    );
                }
            }
        }
    }
}

/// Behind a surface in front of everything, the host's pixels keep their bits.
#[test]
fn hidden_splats_leave_the_hosts_pixels() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, vk::Format::R32G32B32A32_SFLOAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = renderer(&gpu, &model, &scene);
    let (image, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, SIZE, &[0.0; PIXELS]);
    for blend in [Blend::OverDisplay, Blend::OverLinear { gain: 1.0 }] {
        frame.begin();
        image.upload(frame.commands);
        let depth = HostDepth {
            image: &image.source(),
            code: DepthCode::DISTANCE,
        };
        let color = frame.target(CLEARED, COPYABLE);
        let target = HostTarget {
            blend,
            depth: Some(depth),
            ..HostTarget::from(&color)
        };
        let drawn = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), target);
        drawn.unwrap();
        frame.submit();
        assert!(frame.pixels::<f32>().iter().all(|pixel| pixel.map(f64::from) == RED));
    }
}

#[test]
fn blending_that_cannot_be_is_refused() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, vk::Format::R32G32B32A32_SFLOAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut without = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    without.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let mut with = renderer(&gpu, &model, &scene);
    let refusal = |renderer: &mut Renderer, blend, before| {
        frame.begin();
        let color = frame.target(before, COPYABLE);
        let target = HostTarget {
            blend,
            ..HostTarget::from(&color)
        };
        let result = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), target);
        frame.submit();
        frame.pixels::<f32>();
        assert_eq!(host.messages(), Vec::<String>::new());
        result.unwrap_err().to_string()
    };
    let refused = refusal(&mut without, Blend::OverDisplay, CLEARED);
    assert!(refused.contains("with_host_color"), "{refused}");
    let refused = refusal(&mut with, Blend::OverLinear { gain: f32::NAN }, CLEARED);
    assert!(refused.contains("a gain of NaN"), "{refused}");
    let undefined = ImageState {
        layout: vk::ImageLayout::UNDEFINED,
        ..CLEARED
    };
    let refused = refusal(&mut with, Blend::OverDisplay, undefined);
    assert!(refused.contains("UNDEFINED"), "{refused}");
}
