//! Pictures behind a host's surfaces.

use crate::common::scenes::Scene;
use crate::embed::depth::DepthImage;
use crate::embed::frame::{CLEARED, COPYABLE, Frame};
use crate::embed::host::Host;
use crate::embed::{SIZE, adopt, assert_same, expected, scene, view, wrap};
use ash::vk;
use ashfall::gpu::Gpu;
use ashfall::reference::frame::{center, project_all, sorted};
use ashfall::reference::linearize::{Code, limit};
use ashfall::reference::rasterize::{Pixel, discontinuity_margin, rasterize_before};
use ashfall::reference::{Splat, Viewpoint};
use ashfall::render::{Capacity, DepthCode, HostDepth, HostTarget, Model, RenderOptions, Renderer, Stats};

const FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;
const BACKGROUND: [f64; 3] = [0.25, 0.5, 0.75];

fn options() -> RenderOptions {
    RenderOptions {
        with_host_depth: true,
        ..RenderOptions::default()
    }
}

fn renderer(gpu: &Gpu, model: &Model, scene: &Scene) -> Renderer {
    let mut renderer = Renderer::new(gpu, options()).unwrap();
    renderer.reserve(model, &scene.camera, 1 << 16).unwrap();
    renderer
}

/// Draws behind depths, or without. Returns the pixels.
fn draw(
    renderer: &mut Renderer,
    frame: &Frame<'_>,
    (model, scene): (&Model, &Scene),
    depth: Option<(&DepthImage<'_>, DepthCode)>,
) -> (Vec<[f32; 4]>, Option<Stats>) {
    frame.begin();
    let color = frame.target(CLEARED, COPYABLE);
    let source = depth.map(|(image, code)| {
        image.upload(frame.commands);
        (image.source(), code)
    });
    let target = HostTarget {
        depth: source.as_ref().map(|(image, code)| HostDepth { image, code: *code }),
        ..HostTarget::from(&color)
    };
    let stats = renderer.record(&mut wrap(frame), model, &scene.camera, &view(scene), target);
    frame.submit();
    let pixels = frame.pixels();
    (pixels, stats.unwrap())
}

/// Depths of a host's surfaces by pixel: a slope through the scene, which leaves the upper third free, a post one pixel
/// wide, and a piece in front of everything that ends within tiles.
fn surfaces(near: f64, far: f64) -> Vec<f64> {
    let of = |i: usize| {
        let (x, y) = (i % SIZE[0] as usize, i / SIZE[0] as usize);
        match (x, y) {
            (37, _) => near * 1.5,
            (50..63, 20..41) => near * 1.1,
            (_, ..17) => f64::INFINITY,
            _ => near + (far - near) * x as f64 / f64::from(SIZE[0]),
        }
    };
    (0..PIXELS).map(of).collect()
}

struct Expected {
    pixel: Pixel<f64>,
    /// Distance from the nearest threshold, order or limit.
    margin: f64,
}

/// Pixels by the reference, behind limits by pixel.
fn reference(scene: &Scene, limits: &[f64]) -> Vec<Expected> {
    let at = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let (list, _) = sorted(&project_all(&Splat::<f64>::all(&scene.splats), &at));
    let order: Vec<usize> = (0..list.len()).collect();
    let thresholds = &scene.options.thresholds;
    let expected = |i: usize| {
        let at = center(i, SIZE[0] as usize);
        let margin = discontinuity_margin(&list, &order, at, thresholds).nearest();
        let to_limit = list.iter().map(|splat| (splat.depth / limits[i] - 1.0).abs());
        Expected {
            pixel: rasterize_before(&list, &order, at, BACKGROUND, thresholds, limits[i]),
            margin: to_limit.fold(margin, f64::min),
        }
    };
    (0..PIXELS).map(expected).collect()
}

/// Nearest and farthest depth of the drawn splats.
pub(crate) fn depths(scene: &Scene) -> (f64, f64) {
    let at = Viewpoint::new(&scene.camera, &scene.options, scene.splats.filter);
    let (list, _) = sorted(&project_all(&Splat::<f64>::all(&scene.splats), &at));
    (list[0].depth, list[list.len() - 1].depth)
}

/// Every code and format, against the reference with the very depths that are stored. A picture that ignores depth is
/// far off.
#[test]
fn surfaces_hide_the_splats_behind_them() {
    let scene = scene();
    let (nearest, farthest) = depths(&scene);
    let surfaces = surfaces(nearest, farthest);
    let (n, f) = (nearest / 2.0, 4.0 * farthest);
    let perspective = |a: f64, b: f64, empty: f32| DepthCode {
        a: a as f32,
        b: b as f32,
        is_linear: false,
        empty,
    };
    let reversed = perspective(-n / (f - n), f * n / (f - n), 0.0);
    let standard = perspective(f / (f - n), -f * n / (f - n), 1.0);
    let linear = DepthCode {
        a: (-n / (f - n)) as f32,
        b: (f - n).recip() as f32,
        is_linear: true,
        empty: 1.0,
    };
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = renderer(&gpu, &model, &scene);
    let without = draw(&mut renderer, &frame, (&model, &scene), None).0;
    for (code, format) in [
        (perspective(0.0, n, 0.0), vk::Format::D32_SFLOAT),
        (reversed, vk::Format::D32_SFLOAT),
        (standard, vk::Format::D32_SFLOAT),
        (reversed, vk::Format::D16_UNORM),
        (standard, vk::Format::D24_UNORM_S8_UINT),
        (linear, vk::Format::D16_UNORM),
        (DepthCode::DISTANCE, vk::Format::R32_SFLOAT),
    ] {
        let (a, b) = (f64::from(code.a), f64::from(code.b));
        let encode = |&z: &f64| match (z.is_finite(), code.is_linear) {
            (false, _) => f64::from(code.empty),
            (_, true) => a + b * z,
            (_, false) => a + b / z,
        };
        let values: Vec<f64> = surfaces.iter().map(encode).collect();
        let (image, stored) = DepthImage::new(&host, format, SIZE, &values);
        let code64 = Code {
            a,
            b,
            is_linear: code.is_linear,
            empty: code.empty.into(),
        };
        let limits: Vec<f64> = stored.iter().map(|&value| limit(value, &code64)).collect();
        let expected = reference(&scene, &limits);
        let pixels = draw(&mut renderer, &frame, (&model, &scene), Some((&image, code))).0;
        let error = |found: &[[f32; 4]], i: usize| {
            let [red, green, blue] = expected[i].pixel.color;
            let exact = [red, green, blue, 1.0 - expected[i].pixel.transmittance];
            let errors = found[i]
                .iter()
                .zip(exact)
                .map(|(&found, exact)| (f64::from(found) - exact).abs());
            errors.fold(0.0, f64::max)
        };
        let inner: Vec<usize> = (0..PIXELS).filter(|&i| expected[i].margin > 1e-4).collect();
        assert!(inner.len() > PIXELS * 3 / 4, "{format:?}: {} pixels", inner.len());
        let worst = inner.iter().map(|&i| error(&pixels, i)).fold(0.0, f64::max);
        println!(
            "{format:?}, {code:?}: {worst:.2e} in {} of {PIXELS} pixels",
            inner.len()
        );
        // The error of pictures without depth on this scene: limits add none.
        assert!(worst <= 1.9e-6, "{format:?}, {code:?}: {worst}");
        // The upper third is free; of the rest, the nearest surfaces hide nearly all.
        let off = inner.iter().filter(|&&i| error(&without, i) > 0.01).count();
        assert!(
            off > PIXELS / 4,
            "{format:?}: {off} pixels tell a picture without depth"
        );
    }
}

/// Nothing in front: the bits of a picture without depth. Everything in front: none of a splat, and no pair to sort.
#[test]
fn empty_depths_change_no_bit_and_full_ones_leave_nothing() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = renderer(&gpu, &model, &scene);
    let expected = expected(&scene, 1).remove(0);
    let mut isects = Vec::new();
    let infinite = DepthCode {
        a: 0.0,
        b: 0.1,
        is_linear: false,
        empty: 0.0,
    };
    let half: Vec<f64> = (0..PIXELS)
        .map(|i| {
            if i % (SIZE[0] as usize) < SIZE[0] as usize / 2 {
                0.0
            } else {
                f64::INFINITY
            }
        })
        .collect();
    let distance = DepthCode::DISTANCE;
    let (none, _) = DepthImage::new(&host, vk::Format::D32_SFLOAT, SIZE, &[0.0; PIXELS]);
    let (all, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, SIZE, &[0.0; PIXELS]);
    let (left, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, SIZE, &half);
    // A frame reports the one before the last.
    let depths = [
        None,
        Some((&none, infinite)),
        Some((&all, distance)),
        Some((&left, distance)),
    ];
    for depth in depths.into_iter().chain([None; 2]) {
        let (pixels, stats) = draw(&mut renderer, &frame, (&model, &scene), depth);
        isects.extend(stats.map(|stats| stats.isects));
        match depth {
            Some((image, _)) if std::ptr::eq(image, &all) => {
                assert!(pixels.iter().all(|p| *p == [0.25, 0.5, 0.75, 0.0]));
            }
            Some((image, _)) if std::ptr::eq(image, &left) => {
                for (i, pixel) in pixels.iter().enumerate() {
                    let [r, g, b] = expected.rgb[i];
                    let shown = [r, g, b, 1.0 - expected.transmittance[i]];
                    let is_free = i % SIZE[0] as usize >= SIZE[0] as usize / 2;
                    assert_eq!(
                        *pixel,
                        if is_free { shown } else { [0.25, 0.5, 0.75, 0.0] },
                        "pixel {i}"
                    );
                }
            }
            _ => assert_same(&pixels, &expected),
        }
    }
    let [without, empty, full, half] = isects[..4] else {
        panic!("{isects:?}")
    };
    assert!(without > 100 && empty == without && full == 0, "{isects:?}");
    // Tiles of the left half, and the splats of those alone, are not sorted.
    assert!(
        half * 10 < without * 7,
        "{half} of {without} pairs with half of the picture hidden"
    );
}

/// A splat at the limit is hidden, one that is nearer by the last bit is not.
#[test]
fn the_last_bit_of_depth_decides() {
    let mut scene = scene();
    let depth = 3.7f32;
    let camera = &mut scene.camera;
    (camera.rotation, camera.position) = (glam::DMat3::IDENTITY, glam::DVec3::ZERO);
    scene.splats = ashfall::scene::Splats {
        mean: vec![[0.0, 0.0, depth]],
        quaternion: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scale: vec![[0.0; 3]],
        opacity_logit: vec![3.0],
        sh: vec![1.0; 3],
        sh_degree: 0,
        ..Default::default()
    };
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut renderer = renderer(&gpu, &model, &scene);
    for (limit, is_shown) in [(depth.next_down(), false), (depth, false), (depth.next_up(), true)] {
        let (image, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, SIZE, &[f64::from(limit); PIXELS]);
        let (pixels, _) = draw(
            &mut renderer,
            &frame,
            (&model, &scene),
            Some((&image, DepthCode::DISTANCE)),
        );
        let middle = pixels[(SIZE[1] / 2 * SIZE[0] + SIZE[0] / 2) as usize];
        assert_eq!(middle[3] > 0.5, is_shown, "{middle:?} at {limit}");
    }
}

/// Bands of depth, which share a pixel's limit, change no bit.
#[test]
fn bands_behind_surfaces_change_no_bit() {
    let scene = scene();
    let (nearest, farthest) = depths(&scene);
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let (image, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, SIZE, &surfaces(nearest, farthest));
    let depth = Some((&image, DepthCode::DISTANCE));
    let mut whole = renderer(&gpu, &model, &scene);
    let expected = draw(&mut whole, &frame, (&model, &scene), depth).0;
    let capacity = Capacity::for_image(model.splat_count, 16, SIZE[0], SIZE[1]);
    let mut banded = Renderer::new(&gpu, RenderOptions { capacity, ..options() }).unwrap();
    banded.prepare(&model).unwrap();
    let mut bands = 1;
    for _ in 0..8 {
        let (pixels, stats) = draw(&mut banded, &frame, (&model, &scene), depth);
        if let Some(stats) = stats.filter(|stats| stats.complete) {
            bands = stats.bands;
            assert_eq!(pixels, expected);
        }
    }
    assert!(bands > 1, "{bands} bands");
}

#[test]
fn wrong_depths_are_refused() {
    let scene = scene();
    let host = Host::new();
    let frame = Frame::new(&host, FORMAT, SIZE);
    let gpu = adopt(&host, true, true);
    let model = Model::upload(&gpu, &scene.splats).unwrap();
    let mut without = Renderer::new(&gpu, RenderOptions::default()).unwrap();
    without.reserve(&model, &scene.camera, 1 << 16).unwrap();
    let mut with = renderer(&gpu, &model, &scene);
    let (image, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, SIZE, &[1.0; PIXELS]);
    let (small, _) = DepthImage::new(&host, vk::Format::R32_SFLOAT, [8, 8], &[1.0; 64]);
    let flat = DepthCode {
        b: 0.0,
        ..DepthCode::DISTANCE
    };
    let refusal = |renderer: &mut Renderer, image: &DepthImage<'_>, code| {
        frame.begin();
        image.upload(frame.commands);
        let (color, source) = (frame.target(CLEARED, COPYABLE), image.source());
        let depth = Some(HostDepth { image: &source, code });
        let target = HostTarget {
            depth,
            ..HostTarget::from(&color)
        };
        let result = renderer.record(&mut wrap(&frame), &model, &scene.camera, &view(&scene), target);
        frame.submit();
        frame.pixels::<f32>();
        assert_eq!(host.messages(), Vec::<String>::new());
        result.unwrap_err().to_string()
    };
    let refused = refusal(&mut without, &image, DepthCode::DISTANCE);
    assert!(refused.contains("with_host_depth"), "{refused}");
    let refused = refusal(&mut with, &small, DepthCode::DISTANCE);
    assert!(refused.contains("8x8 pixels, the image to draw to 72x50"), "{refused}");
    let refused = refusal(&mut with, &image, flat);
    assert!(refused.contains("b is not 0"), "{refused}");
}
