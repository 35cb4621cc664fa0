//! Compositing of each pixel.

use crate::common::check::*;
use crate::common::lists::{Lists, view};
use crate::common::scenes::{self, Scene};
use crate::common::{device, pack};
use crate::kernels::lane_choices;
use ashfall::gpu::{DeviceKind, Gpu, Groups};
use ashfall::kernels::rasterize::{Bindings, Choice, Outputs, Params, Rasterize};
use ashfall::layout::{COUNT_BAND_END, COUNT_VISIBLE};
use ashfall::reference::frame::{center, depth_order};
use ashfall::reference::rasterize::{blended, discontinuity_margin, rasterize};
use ashfall::reference::{ScreenSplat, Thresholds};
use ashfall::render::list_limit;

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

/// The variants with every number of lanes that they can have on this device.
fn choices(gpu: &Gpu) -> Vec<Choice> {
    let outputs = |(depth, ends)| Outputs { depth, ends };
    let outputs = [(false, true), (true, true), (false, false)].map(outputs);
    lane_choices!(rasterize, gpu)
        .flat_map(|choice| outputs.map(|outputs| choice.of_outputs(outputs)))
        .collect()
}

/// Image planes, depth and the end of each pixel's list, with the pixels that are near a discontinuity.
pub(crate) struct Expected {
    pub(crate) planes: [Vec<f64>; 5],
    pub(crate) ends: Vec<f64>,
    pub(crate) near: Vec<bool>,
}

pub(crate) fn expected(scene: &Scene, lists: &Lists) -> Expected {
    let (thresholds, background) = (Thresholds::ENGINE, scene.options.background);
    let order = depth_order(&lists.screen);
    let splats: Vec<ScreenSplat<f64>> = order.iter().filter_map(|&i| lists.screen[i]).collect();
    let ranks: Vec<usize> = (0..splats.len()).collect();
    let grid = &lists.grid;
    let mut all = Expected {
        planes: Default::default(),
        ends: Vec::new(),
        near: Vec::new(),
    };
    for i in 0..(grid.width * grid.height) as usize {
        let at = center(i, grid.width as usize);
        let pixel = rasterize(
            &splats,
            &ranks,
            at,
            background.map(|c| f64::from(c as f32)),
            &thresholds,
        );
        let [r, g, b] = pixel.color;
        for (plane, value) in [r, g, b, pixel.transmittance, pixel.depth]
            .iter()
            .enumerate()
        {
            all.planes[plane].push(*value);
        }
        all.near
            .push(discontinuity_margin(&splats, &ranks, at, &thresholds).nearest() < 1e-4);
        let last = blended(&splats, &ranks, at, &thresholds).last().copied();
        let [begin, end] = lists.range_from_tile[grid.tile_from_position(at) as usize];
        let place = last.and_then(|rank| {
            (begin..end).find(|&isect| {
                let source = lists.emitted_from_isect[isect as usize];
                lists.isects[source as usize].splat as usize == order[rank]
            })
        });
        all.ends
            .push(place.map_or(0.0, |isect| f64::from(isect + 1)));
    }
    all
}

/// What the kernel makes of lists that come in bands, each with its slices: image, depth, and the ends of each band.
fn run(
    gpu: &Gpu,
    kernel: &Rasterize,
    scene: &Scene,
    lists: &Lists,
    bands: &[&[[u32; 2]]],
) -> (Vec<f32>, Vec<f32>, Vec<Vec<u32>>) {
    let pixels = (lists.grid.width * lists.grid.height) as usize;
    let (shapes, tones, rests) = pack::arrays(&lists.records);
    let (image, depth) = (unwritten(gpu, 4 * pixels), unwritten(gpu, pixels));
    let mut ends = Vec::new();
    for (band, slices) in bands.iter().enumerate() {
        let end = unwritten(gpu, pixels);
        let done = (COUNT_BAND_END, band as u32 + 1);
        let io = Bindings {
            view: &buffer(gpu, &[view(scene)]),
            counts: &counts(gpu, &[done, (COUNT_VISIBLE, bands.len() as u32)]),
            range_from_tile: &buffer(gpu, slices),
            emitted_from_isect: &buffer(gpu, &lists.emitted_from_isect),
            splat_from_emitted: &buffer(gpu, &lists.splat_from_emitted()),
            ellipse_from_splat: &buffer(gpu, &shapes),
            whiten_rg_from_splat: &buffer(gpu, &tones),
            blue_depth_from_splat: &buffer(gpu, &rests),
            image: &image,
            depth: &depth,
            isect_end_from_pixel: &end,
        };
        // One band more is recorded than is needed.
        let params = Params {
            tile_stride: 1,
            band: band as u32,
            band_count: bands.len() as u32 + 1,
        };
        let tiles = lists.grid.len() as usize;
        gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(tiles as u32)))
            .unwrap();
        ends.push(read(gpu, &end));
    }
    (read(gpu, &image), read(gpu, &depth), ends)
}

#[test]
fn bands_change_no_bit() {
    let gpu = device::gpu();
    for choice in choices(&gpu) {
        let kernel = Rasterize::new(&gpu, choice).unwrap();
        for (name, scene) in cases() {
            let lists = Lists::new(&scene);
            let slices = &lists.range_from_tile;
            let (image, depth, ends) = run(&gpu, &kernel, &scene, &lists, &[slices]);
            // A short band, one of nothing, and the rest.
            let cut = |&[begin, end]: &[u32; 2]| begin + (end - begin) / 5;
            let first: Vec<_> = slices.iter().map(|s| [s[0], cut(s)]).collect();
            let nothing: Vec<_> = slices.iter().map(|s| [cut(s); 2]).collect();
            let rest: Vec<_> = slices.iter().map(|s| [cut(s), s[1]]).collect();
            let found = run(&gpu, &kernel, &scene, &lists, &[&first, &nothing, &rest]);
            let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert!(bits(&found.0) == bits(&image), "{name}, {choice:?}: image");
            assert!(bits(&found.1) == bits(&depth), "{name}, {choice:?}: depth");
            if choice.spec.with_ends == 0 {
                continue;
            }
            for (i, &end) in ends[0].iter().enumerate() {
                let in_bands: Vec<u32> = found.2.iter().map(|ends| ends[i]).collect();
                assert_eq!(
                    in_bands.iter().max(),
                    Some(&end),
                    "{name}, {choice:?}: pixel {i}"
                );
                assert_eq!(in_bands[1], 0, "{name}, {choice:?}: pixel {i}");
            }
        }
    }
}

#[test]
fn pixels_are_composited() {
    let gpu = device::gpu();
    let mut check = Check::new("rasterize");
    let cases: Vec<_> = cases()
        .into_iter()
        .map(|(name, scene)| {
            let lists = Lists::new(&scene);
            let expected = expected(&scene, &lists);
            (name, scene, lists, expected)
        })
        .collect();
    for choice in choices(&gpu) {
        let kernel = Rasterize::new(&gpu, choice).unwrap();
        for (name, scene, lists, expected) in &cases {
            let pixels = expected.ends.len();
            let (image, depth, ends) = run(&gpu, &kernel, scene, lists, &[&lists.range_from_tile]);
            let found = floats(&image);
            // An error of the exponent is a relative error of alpha, and compositing never amplifies that: at
            // positions up to 16 px from the tile's corner, standard deviations from 0.55 px and residuals up to
            // 3.3, it is 2 · 3.3 · ulp(16) / 0.55 = 1.2e-5, times the range of colours and depths. Where an
            // alpha or a transmittance meets its threshold, one splat of 1/255 or the last 1e-4 may flip.
            let tolerance = 2e-5;
            let jump = 1.0 / 255.0;
            let near = &expected.near;
            let [r, g, b, through, far] = &expected.planes;
            let color = [r.as_slice(), g, b].concat();
            let three = [near.as_slice(), near, near].concat();
            let expected_ends = match choice.spec.with_ends {
                0 => vec![f64::NAN; pixels],
                _ => expected.ends.clone(),
            };
            let mut outputs = vec![
                Output::relative(
                    "colour",
                    found[..3 * pixels].to_vec(),
                    color,
                    tolerance,
                    1.0,
                )
                .near(three, jump, 0.01),
                Output::relative(
                    "transmittance",
                    found[3 * pixels..].to_vec(),
                    through.clone(),
                    tolerance,
                    1.0,
                )
                .near(near.clone(), jump, 0.01),
                Output::exact("ends", words(&ends[0]), expected_ends).near(
                    near.clone(),
                    f64::INFINITY,
                    0.02,
                ),
            ];
            let depths = floats(&depth);
            let expected_depth = match choice.spec.with_depth {
                0 => vec![f64::NAN; pixels],
                _ => far.clone(),
            };
            outputs.push(
                Output::relative("depth", depths, expected_depth, tolerance, 6.0).near(
                    near.clone(),
                    6.0 * jump,
                    0.01,
                ),
            );
            let case = format!("{name}, {:?} {}", choice.variant, choice.spec.workgroup);
            check.outputs(&case, outputs);
        }
    }
    check.finish();
}

#[test]
fn a_list_as_long_as_allowed_is_composited_to_its_end() {
    let gpu = device::gpu();
    // So many splats over one tile, so small and faint that what passes them all is far above the stop.
    let mut scene = scenes::gentle(5, 230_000, 8, 16, 0);
    for logit in &mut scene.splats.opacity_logit {
        *logit = -5.28;
    }
    for scale in scene.splats.log_scale.iter_mut().flatten() {
        *scale = -9.0;
    }
    let lists = Lists::new(&scene);
    let len = list_limit(DeviceKind::Cpu);
    assert!(lists.range_from_tile[0][1] >= len);
    let pieces: Vec<[[u32; 2]; 1]> = (0..len)
        .step_by(9000)
        .map(|begin| [[begin, (begin + 9000).min(len)]])
        .collect();
    let pieces: Vec<&[[u32; 2]]> = pieces.iter().map(|piece| &piece[..]).collect();
    for choice in choices(&gpu) {
        let kernel = Rasterize::new(&gpu, choice).unwrap();
        let (whole, ..) = run(&gpu, &kernel, &scene, &lists, &[&[[0, len]]]);
        let (piecewise, ..) = run(&gpu, &kernel, &scene, &lists, &pieces);
        assert!(whole == piecewise, "{choice:?}");
        assert!(whole[3 * 128..].iter().all(|&through| through > 0.01));
    }
}
