//! Compositing of each pixel.

use crate::common::check::*;
use crate::common::device;
use crate::common::lists::Lists;
use crate::common::scenes::{self, Scene};
use crate::kernels::LANES;
use ashfall::gpu::{DeviceKind, Gpu};
use ashfall::kernels::Kernel;
use ashfall::kernels::rasterize::{Bindings, Choice, Outputs, Params, Rasterize, SurfelMode, Variant};
use ashfall::lab::bench::kernels::composite::rasterize;
use ashfall::lab::bench::kernels::{Composite, CompositeBuffers};
use ashfall::layout::{COUNT_BAND_END, COUNT_VISIBLE, SPREAD_PLANES};
use ashfall::render::list_limit;
use ashfall::scene::ScreenFilter;

/// Many faint splats over one tile: the list is long and ends by itself.
fn long_list(count: usize) -> Scene {
    let mut scene = scenes::gentle(20, count, 8, 16, 0);
    for logit in &mut scene.splats.opacity_logit {
        *logit = -4.5;
    }
    scene
}

/// Opaque splats in front of others: pixels stop early.
fn opaque_stack() -> Scene {
    let mut scene = scenes::gentle(21, 120, 40, 33, 0);
    for (i, logit) in scene.splats.opacity_logit.iter_mut().enumerate() {
        *logit = if i % 2 == 0 { 12.0 } else { 2.0 };
    }
    scene
}

/// Wide splats so opaque that their alphas meet the cap over whole areas, half of them thinly covered.
fn capped() -> Scene {
    let mut scene = scenes::gentle(22, 24, 40, 33, 0);
    for (i, logit) in scene.splats.opacity_logit.iter_mut().enumerate() {
        let opaque = i % 4 == 0;
        *logit = if opaque { 17.0 } else { -2.0 };
        if opaque {
            scene.splats.log_scale[i] = [3.0; 3];
        }
    }
    scene
}

/// Surfels with spots, and with the mip filter.
pub(crate) fn surfels() -> [(&'static str, SurfelMode, Scene); 3] {
    [
        ("spots", SurfelMode::Any, ScreenFilter::Classic),
        ("mip", SurfelMode::Any, ScreenFilter::Mip),
        ("mip alone", SurfelMode::Mip, ScreenFilter::Mip),
    ]
    .map(|(name, mode, filter)| (name, mode, scenes::flattened(scenes::gentle(23, 80, 65, 47, 0), filter)))
}

pub(crate) fn cases() -> Vec<(&'static str, Scene)> {
    vec![
        ("nothing to draw", scenes::gentle(10, 0, 20, 20, 0)),
        ("one", scenes::gentle(11, 1, 20, 20, 0)),
        ("one pixel", scenes::gentle(12, 9, 1, 1, 0)),
        ("one tile", scenes::gentle(13, 30, 8, 16, 0)),
        ("a pixel more than a tile", scenes::gentle(14, 30, 9, 17, 0)),
        ("gentle", scenes::gentle(15, 80, 65, 47, 0)),
        ("hard", scenes::hard(16, 90, 33, 47, 0)),
        ("opaque stack", opaque_stack()),
        ("capped", capped()),
        ("a long list", long_list(1500)),
    ]
}

/// The cases, and those of surfels, by tiles of the engine.
pub(crate) fn composites_of_kinds() -> Vec<(&'static str, Composite)> {
    let surfels = surfels().into_iter().filter(|(_, mode, _)| *mode == SurfelMode::Any);
    let scenes = cases().into_iter().chain(surfels.map(|(name, _, scene)| (name, scene)));
    scenes.map(|(name, scene)| (name, Composite::of(scene))).collect()
}

/// The cases by tiles of the engine or of a baseline.
pub(crate) fn composites(of: fn(Scene) -> Composite) -> Vec<(&'static str, Composite)> {
    cases().into_iter().map(|(name, scene)| (name, of(scene))).collect()
}

/// As many splats over one tile as its list may hold on a software device, so small and faint that the transmittance
/// behind them all is far above the stop.
pub(crate) fn longest() -> Scene {
    let mut scene = scenes::gentle(5, 230_000, 8, 16, 0);
    scene.splats.opacity_logit.fill(-5.28);
    scene.splats.log_scale.fill([-9.0; 3]);
    let listed = Lists::new(&scene).splat_from_isect();
    let len = list_limit(DeviceKind::Cpu) as usize;
    assert!(listed.len() >= len);
    for &splat in &listed[len..] {
        scene.splats.opacity_logit[splat as usize] = -30.0;
    }
    scene
}

/// Outputs of compositing: the least, the usual and the most.
const OUTPUTS: [Outputs; 5] = [
    Outputs::TRAINING,
    Outputs {
        depth: true,
        surface: true,
        spread: true,
        ..Outputs::TRAINING
    },
    Outputs {
        ends: false,
        ..Outputs::TRAINING
    },
    Outputs {
        ends: false,
        surface: true,
        ..Outputs::TRAINING
    },
    Outputs {
        ends: false,
        ids: true,
        ..Outputs::TRAINING
    },
];

/// The variants with every number of lanes that they can have on this device.
fn choices(gpu: &Gpu) -> Vec<Choice> {
    let choices = LANES.choices::<Rasterize>(gpu.caps()).into_iter();
    let pairs = choices.flat_map(|(choice, _)| OUTPUTS.map(|outputs| (choice, outputs)));
    pairs
        .filter(|(choice, outputs)| choice.variant != Variant::Blocks || !outputs.has_planes())
        .map(|(choice, outputs)| choice.of_outputs(outputs))
        .collect()
}

/// Bits of the image, of depth and of surfaces, and the ends of each band, of lists that come in bands.
fn run(
    gpu: &Gpu,
    kernel: &Rasterize,
    input: &CompositeBuffers,
    pixels: usize,
    bands: &[&[[u32; 2]]],
    with_ids: bool,
) -> (Vec<u32>, Vec<u32>, Vec<Vec<u32>>) {
    let (image, depth) = (unwritten::<f32>(gpu, 4 * pixels), unwritten::<f32>(gpu, pixels));
    let surface = unwritten::<f32>(gpu, SPREAD_PLANES as usize * pixels);
    let mut ends = Vec::new();
    let ids = unwritten(gpu, pixels);
    for (band, slices) in bands.iter().enumerate() {
        // Bands share the splats of pixels, and each has ends of its own.
        let end = if with_ids { ids.clone() } else { unwritten(gpu, pixels) };
        let done = (COUNT_BAND_END, band as u32 + 1);
        let io = Bindings {
            counts: &counts(gpu, &[done, (COUNT_VISIBLE, bands.len() as u32)]),
            range_from_tile: &buffer(gpu, slices),
            image: &image,
            depth: &depth,
            surface: &surface,
            isect_end_from_pixel: &end,
            ..input.rasterize()
        };
        // One band more is recorded than is needed.
        let params = Params {
            band: band as u32,
            band_count: bands.len() as u32 + 1,
            ..input.params()
        };
        gpu.run(|rec| kernel.record(rec, io, params, input.groups())).unwrap();
        ends.push(read(gpu, &end));
    }
    let bits = |buffer| -> Vec<u32> { read(gpu, buffer).iter().map(|x: &f32| x.to_bits()).collect() };
    (bits(&image), [bits(&depth), bits(&surface)].concat(), ends)
}

#[test]
fn bands_change_no_bit() {
    let gpu = device::gpu();
    let composites = composites(Composite::of);
    for choice in choices(&gpu) {
        let (kernel, with_ids) = (Rasterize::compile(&gpu, choice).unwrap(), choice.spec.with_ids != 0);
        for (name, composite) in &composites {
            let (slices, pixels) = (&composite.lists.range_from_tile, composite.pixels.len());
            let input = CompositeBuffers::new(&gpu, composite).unwrap();
            let (image, depth, ends) = run(&gpu, &kernel, &input, pixels, &[slices], with_ids);
            // A short band, one of nothing, and the rest.
            let cut = |&[begin, end]: &[u32; 2]| begin + (end - begin) / 5;
            let first: Vec<_> = slices.iter().map(|s| [s[0], cut(s)]).collect();
            let nothing: Vec<_> = slices.iter().map(|s| [cut(s); 2]).collect();
            let rest: Vec<_> = slices.iter().map(|s| [cut(s), s[1]]).collect();
            let found = run(&gpu, &kernel, &input, pixels, &[&first, &nothing, &rest], with_ids);
            assert!(found.0 == image, "{name}, {choice:?}: image");
            assert!(found.1 == depth, "{name}, {choice:?}: depth or surface");
            if with_ids {
                assert!(found.2.last() == ends.last(), "{name}, {choice:?}: ids");
            }
            if choice.spec.with_ends == 0 {
                continue;
            }
            for (i, &end) in ends[0].iter().enumerate() {
                let in_bands: Vec<u32> = found.2.iter().map(|ends| ends[i]).collect();
                let last = in_bands.iter().max();
                assert_eq!(last, Some(&end), "{name}, {choice:?}: pixel {i}");
                assert_eq!(in_bands[1], 0, "{name}, {choice:?}: pixel {i}");
            }
        }
    }
}

#[test]
fn pixels_are_composited() {
    let gpu = device::gpu();
    let mut check = Check::new("rasterize");
    let composites = composites(Composite::of);
    for outputs in OUTPUTS {
        let case = |of| rasterize(&gpu, of, outputs).unwrap();
        let cases: Vec<_> = composites.iter().map(|(name, of)| (*name, case(of))).collect();
        check.cases(&gpu, LANES, &cases);
    }
    check.finish();
}

#[test]
fn surfels_are_composited() {
    let gpu = device::gpu();
    let mut check = Check::new("rasterize");
    let outputs = |surfels| Outputs {
        depth: true,
        surface: true,
        spread: true,
        surfels,
        ..Outputs::TRAINING
    };
    let composites = surfels().map(|(name, mode, scene)| (name, mode, Composite::of(scene)));
    let cases: Vec<_> = composites
        .iter()
        .map(|(name, mode, of)| (*name, rasterize(&gpu, of, outputs(*mode)).unwrap()))
        .collect();
    check.cases(&gpu, LANES, &cases);
    check.finish();
}

#[test]
fn a_list_as_long_as_allowed_is_composited_to_its_end() {
    let gpu = device::gpu();
    let composite = Composite::of(longest());
    let input = CompositeBuffers::new(&gpu, &composite).unwrap();
    let len = list_limit(DeviceKind::Cpu);
    assert_eq!(composite.lists.range_from_tile, [[0, len]]);
    let pieces: Vec<[[u32; 2]; 1]> = (0..len)
        .step_by(9000)
        .map(|begin| [[begin, (begin + 9000).min(len)]])
        .collect();
    let pieces: Vec<&[[u32; 2]]> = pieces.iter().map(|piece| &piece[..]).collect();
    for choice in choices(&gpu) {
        let kernel = Rasterize::compile(&gpu, choice).unwrap();
        let (whole, ..) = run(&gpu, &kernel, &input, 128, &[&[[0, len]]], false);
        let (piecewise, ..) = run(&gpu, &kernel, &input, 128, &pieces, false);
        assert!(whole == piecewise, "{choice:?}");
        let through = whole[3 * 128..].iter().map(|&bits| f32::from_bits(bits));
        assert!(through.min_by(f32::total_cmp).unwrap() > 0.01);
    }
}
