//! Splats and depths of pixels in a host's images, and reports of picked pixels.

use crate::common::scenes::Scene;
use crate::embed::depth::DepthImage;
use crate::embed::frame::{CLEARED, COPYABLE, Frame};
use crate::embed::host::Host;
use crate::embed::words::WordImage;
use crate::embed::{SIZE, adopt, scene, view, watch, wrap};
use ash::vk;
use ashfall::gpu::Gpu;
use ashfall::layout::NO_SPLAT;
use ashfall::reference::delinearize::{mean_depth, stored};
use ashfall::reference::linearize::Code;
use ashfall::render::{
    Capacity, DepthCode, DepthKind, HostDepth, HostTarget, Instance, Model, PickArea, PickReport, RenderOptions,
    RenderedImage, Renderer, locate,
};
use ashfall::scene::Similarity;
use glam::DVec3;

const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;

const WITH_IDS: fn() -> RenderOptions = || RenderOptions {
    with_ids: true,
    with_host_depth: true,
    ..RenderOptions::default()
};

/// The picture with its splats on a device of the engine's own.
fn own(scene: &Scene) -> RenderedImage {
    let gpu = crate::common::device::gpu();
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = Renderer::new(&gpu, WITH_IDS()).unwrap();
    renderer.render(&model, &scene.camera, &view(scene)).unwrap()
}

fn renderer(gpu: &Gpu, model: &Model, scene: &Scene) -> Renderer {
    let mut renderer = Renderer::new(gpu, WITH_IDS()).unwrap();
    renderer.reserve(model, &scene.camera, 1 << 16).unwrap();
    renderer
}

/// Splats and depths in a host's images, in every code and format, with a surface of the host before some of them.
#[test]
fn images_have_the_splats_and_the_nearest_depths() {
    let scene = scene();
    let expected = own(&scene);
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = renderer(&gpu, &model, &scene);
    let found: Vec<f32> = expected.id_depth.iter().copied().filter(|z| z.is_finite()).collect();
    assert!(
        found.len() > PIXELS / 4 && found.len() < PIXELS,
        "{} pixels",
        found.len()
    );
    let farthest = f64::from(found.iter().copied().fold(0.0, f32::max));
    // Behind every splat on the left, nowhere on the right.
    let surfaces: Vec<f64> = (0..PIXELS)
        .map(|i| match i % (SIZE[0] as usize) < 30 {
            true => 1.5 * farthest,
            false => f64::INFINITY,
        })
        .collect();
    let (before, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, SIZE, &surfaces);
    let reversed = DepthCode {
        a: 0.0,
        b: 0.125,
        is_linear: false,
        empty: 0.0,
    };
    let linear = DepthCode {
        a: -0.01,
        b: 0.01,
        is_linear: true,
        empty: 1.0,
    };
    let ids = WordImage::new(&host, vk::Format::R32_UINT, SIZE);
    for (code, format, with_host) in [
        (reversed, vk::Format::D32_SFLOAT, false),
        (reversed, vk::Format::D32_SFLOAT, true),
        (linear, vk::Format::D32_SFLOAT, true),
        (DepthCode::DISTANCE, vk::Format::R32_SFLOAT, false),
    ] {
        let depths = WordImage::new(&host, format, SIZE);
        frame.begin();
        before.upload(frame.commands);
        let (color, source) = (frame.target(CLEARED, COPYABLE), before.source());
        let (ids_out, depth_out) = (ids.target(), depths.target());
        let target = HostTarget {
            depth: with_host.then_some(HostDepth {
                image: &source,
                code: DepthCode::DISTANCE,
            }),
            ids: Some(&ids_out),
            depth_out: Some(HostDepth {
                image: &depth_out,
                code,
            }),
            ..HostTarget::from(&color)
        };
        let drawn = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), target);
        drawn.unwrap();
        ids.download(frame.commands);
        depths.download(frame.commands);
        frame.submit();
        frame.pixels::<f32>();
        assert_eq!(host.messages(), Vec::<String>::new());
        assert!(ids.words::<u32>() == expected.ids, "{code:?}: splats");
        let code64 = Code {
            a: code.a.into(),
            b: code.b.into(),
            is_linear: code.is_linear,
            empty: code.empty.into(),
        };
        for (i, &value) in depths.words::<f32>().iter().enumerate() {
            let limit = if with_host {
                f64::from(surfaces[i] as f32)
            } else {
                f64::INFINITY
            };
            let wanted = stored(expected.id_depth[i].into(), limit, &code64);
            // Rounding of a product or quotient and a sum, as of the kernel.
            let bound = 4e-7 * (wanted.abs() + code64.a.abs());
            let is_same = wanted == f64::from(value) || (f64::from(value) - wanted).abs() <= bound;
            assert!(is_same, "{code:?}, pixel {i}: {value}, {wanted}");
        }
    }
}

/// Mean depths by weight in a host's image, those of the same picture read back.
#[test]
fn images_have_the_expected_depths() {
    let scene = scene();
    let options = RenderOptions {
        with_depth: true,
        ..WITH_IDS()
    };
    let own = {
        let gpu = crate::common::device::gpu();
        let model = Model::upload(&gpu, &scene.splats).unwrap();
        let mut renderer = Renderer::new(&gpu, options).unwrap();
        renderer.render(&model, &scene.camera, &view(&scene)).unwrap()
    };
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let depths = WordImage::new(&host, vk::Format::R32_SFLOAT, SIZE);
    for (options, is_drawn) in [(options, true), (WITH_IDS(), false)] {
        let mut renderer = Renderer::new(&gpu, options).unwrap();
        renderer.reserve(&model, &scene.camera, 1 << 16).unwrap();
        frame.begin();
        let (color, depth_out) = (frame.target(CLEARED, COPYABLE), depths.target());
        let target = HostTarget {
            depth_out: Some(HostDepth {
                image: &depth_out,
                code: DepthCode::DISTANCE,
            }),
            depth_kind: DepthKind::Expected,
            ..HostTarget::from(&color)
        };
        let drawn = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), target);
        depths.download(frame.commands);
        frame.submit();
        frame.pixels::<f32>();
        match is_drawn {
            true => assert_eq!(drawn.unwrap(), None),
            false => assert!(drawn.unwrap_err().to_string().contains("RenderOptions::with_depth")),
        }
        if !is_drawn {
            continue;
        }
        let mut covered = 0;
        for (i, &found) in depths.words::<f32>().iter().enumerate() {
            let wanted = mean_depth(own.depth[i].into(), own.transmittance[i].into());
            covered += u32::from(wanted.is_finite());
            let is_same = wanted == f64::from(found) || (f64::from(found) / wanted - 1.0).abs() < 1e-6;
            assert!(is_same, "pixel {i}: {found}, {wanted}");
        }
        assert!(
            covered as usize > PIXELS / 4 && (covered as usize) < PIXELS,
            "{covered}"
        );
    }
    assert_eq!(host.messages(), Vec::<String>::new());
}

fn check_report(report: &PickReport, expected: &RenderedImage) {
    let PickArea { x, y, width, height } = report.area;
    assert_eq!(report.pixels.len(), (width * height) as usize);
    for (i, pixel) in (0..).zip(&report.pixels) {
        let at = ((y + i / width) * SIZE[0] + x + i % width) as usize;
        let id = expected.ids[at];
        let wanted = (id != NO_SPLAT).then_some((0, id as usize));
        assert_eq!(
            (pixel.splat, pixel.depth),
            (wanted, expected.id_depth[at]),
            "pixel {at}"
        );
        assert_eq!(pixel.transmittance, expected.transmittance[at], "pixel {at}");
    }
}

/// A thousand pixels, and single ones in the corners, reported with the statistics of their frame; nothing waits, and
/// bands give the same report.
#[test]
fn picked_pixels_are_reported_frames_later() {
    let scene = scene();
    let expected = own(&scene);
    let host = Host::new();
    let frames = [Frame::new(&host, FORMAT, SIZE), Frame::new(&host, FORMAT, SIZE)];
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let capacity = Capacity::for_image(model.splat_count, 16, SIZE[0], SIZE[1]);
    let mut banded = Renderer::new(&gpu, RenderOptions { capacity, ..WITH_IDS() }).unwrap();
    banded.prepare(&model).unwrap();
    let area = |x, y, width, height| PickArea { x, y, width, height };
    let areas = [
        Some(area(20, 10, 40, 25)),
        None,
        Some(area(0, 0, 1, 1)),
        Some(area(SIZE[0] - 1, SIZE[1] - 1, 1, 1)),
    ];
    for (renderer, rounds) in [(&mut renderer(&gpu, &model, &scene), 6), (&mut banded, 10)] {
        let (mut reports, mut asked, mut is_complete) = (Vec::new(), Vec::new(), false);
        for round in 0..rounds {
            let (frame, pick) = (&frames[round % 2], areas[round % 4]);
            frame.begin();
            let color = frame.target(CLEARED, COPYABLE);
            let target = HostTarget {
                pick,
                ..HostTarget::from(&color)
            };
            watch::calls();
            let stats = renderer.record(&mut wrap(frame), &model, &scene.camera, &view(&scene), target);
            let calls = watch::calls();
            assert!(
                !calls
                    .iter()
                    .any(|call| call.contains("Wait") || call.contains("Submit")),
                "{calls:?}"
            );
            let before = reports.len();
            reports.extend(renderer.picks());
            asked.extend(pick);
            // A frame reports the one before the last.
            let wanted = usize::from(round >= 2 && areas[(round - 2) % 4].is_some());
            assert_eq!(reports.len() - before, wanted, "round {round}");
            if let Some(stats) = stats.unwrap() {
                is_complete |= stats.complete;
                if wanted == 1 && stats.complete {
                    check_report(&reports[before], &expected);
                }
            }
            frame.submit();
        }
        frames.iter().for_each(|frame| drop(frame.pixels::<f32>()));
        assert!(
            is_complete
                && reports
                    .iter()
                    .map(|report| report.area)
                    .eq(asked[..reports.len()].iter().copied())
        );
        assert!(reports.len() >= 3);
    }
    assert_eq!(host.messages(), Vec::<String>::new());
}

/// Splats of instances are told by the instance and their index in its model.
#[test]
fn splats_of_instances_are_located() {
    let scene = scene();
    let gpu = crate::common::device::gpu();
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let first = Instance {
        world_from_model: Similarity {
            translation: DVec3::splat(1e4),
            ..Similarity::IDENTITY
        },
        ..Instance::new(&model)
    };
    let instances = [first, Instance::new(&model)];
    let mut renderer = Renderer::new(&gpu, WITH_IDS()).unwrap();
    let found = renderer
        .render_instances(&instances, &scene.camera, &view(&scene))
        .unwrap();
    let expected = own(&scene);
    for (id, lone) in found.ids.iter().zip(&expected.ids) {
        let wanted = (*lone != NO_SPLAT).then_some((1, *lone as usize));
        assert_eq!(locate(&instances, *id), wanted);
    }
    assert!(found.id_depth == expected.id_depth);
}

#[test]
fn wrong_outputs_are_refused() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut without = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    without.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let mut with = renderer(&gpu, &model, &scene);
    let words = WordImage::new(&host, vk::Format::R32_UINT, SIZE);
    let small = WordImage::new(&host, vk::Format::R32_UINT, [8, 8]);
    let refusal = |renderer: &mut Renderer, words: &WordImage<'_>, is_depth: bool, pick: Option<PickArea>| {
        frame.begin();
        let (color, out) = (frame.target(CLEARED, COPYABLE), words.target());
        let depth = HostDepth {
            image: &out,
            code: DepthCode::DISTANCE,
        };
        let target = HostTarget {
            ids: (!is_depth && pick.is_none()).then_some(&out),
            depth_out: is_depth.then_some(depth),
            pick,
            ..HostTarget::from(&color)
        };
        let result = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), target);
        frame.submit();
        frame.pixels::<f32>();
        assert_eq!(host.messages(), Vec::<String>::new());
        result.unwrap_err().to_string()
    };
    let refused = refusal(&mut without, &words, false, None);
    assert!(refused.contains("with_ids"), "{refused}");
    let refused = refusal(&mut with, &small, false, None);
    assert!(refused.contains("8x8 pixels, the image to draw to 72x50"), "{refused}");
    let refused = refusal(&mut with, &words, true, None);
    assert!(refused.contains("R32_UINT for depths"), "{refused}");
    for [x, y, width, height] in [[0, 0, 0, 1], [72, 0, 1, 1], [0, 49, 1, 2], [1, 0, u32::MAX, 1]] {
        let area = PickArea { x, y, width, height };
        let refused = refusal(&mut with, &words, false, Some(area));
        assert!(refused.contains("within the 72x50 of the picture"), "{refused}");
    }
}
