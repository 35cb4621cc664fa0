//! Gradient of compositing for each intersection.

use crate::common::check::*;
use crate::common::lists::{Lists, view};
use crate::common::scenes::{Random, Scene};
use crate::common::{device, pack};
use crate::kernels::lane_choices;
use crate::kernels::rasterize::cases;
use ashfall::gpu::Groups;
use ashfall::kernels::rasterize_backward::{Bindings, Params, RasterizeBackward};
use ashfall::reference::frame::{center, depth_order};
use ashfall::reference::rasterize::{blended, discontinuity_margin, rasterize};
use ashfall::reference::rasterize_backward::{PixelGradient, isect_backward};
use ashfall::reference::{ScreenSplat, Thresholds};

/// What the forward pass left, a gradient of the image, and the sums that should come of it.
pub(crate) struct Case {
    pub(crate) image: Vec<f32>,
    pub(crate) ends: Vec<u32>,
    pub(crate) d_image: Vec<f32>,
    /// `[quantity][source]`.
    pub(crate) sums: [Vec<f64>; 9],
}

pub(crate) fn prepare(scene: &Scene, lists: &Lists) -> Case {
    let thresholds = Thresholds::ENGINE;
    let background = scene.options.background.map(|c| f64::from(c as f32));
    let order = depth_order(&lists.screen);
    let splats: Vec<ScreenSplat<f64>> = order.iter().filter_map(|&i| lists.screen[i]).collect();
    let ranks: Vec<usize> = (0..splats.len()).collect();
    let grid = &lists.grid;
    let pixels = (grid.width * grid.height) as usize;
    let random = &mut Random::new(pixels as u64);
    let mut case = Case {
        image: vec![0.0; 4 * pixels],
        ends: vec![0; pixels],
        d_image: vec![0.0; 3 * pixels],
        sums: Default::default(),
    };
    let mut upstream = vec![PixelGradient::default(); pixels];
    for (i, upstream) in upstream.iter_mut().enumerate() {
        let at = center(i, grid.width as usize);
        let pixel = rasterize(&splats, &ranks, at, background, &thresholds);
        case.image[3 * pixels + i] = pixel.transmittance as f32;
        let [begin, end] = lists.range_from_tile[grid.tile_from_position(at) as usize];
        if let Some(&rank) = blended(&splats, &ranks, at, &thresholds).last() {
            let is_last = |&isect: &u32| {
                let source = lists.emitted_from_isect[isect as usize];
                lists.isects[source as usize].splat as usize == order[rank]
            };
            case.ends[i] = (begin..end).find(is_last).unwrap() + 1;
        }
        // A pixel at a discontinuity might go either way: it is given nothing to say.
        let margin = discontinuity_margin(&splats, &ranks, at, &thresholds);
        // The cap itself is within 1.5e-5 of everything that it caps.
        if margin.nearest() > 1e-4 && margin.alpha_max > 2e-6 {
            upstream.color = [0; 3].map(|_| random.normal());
        }
        for channel in 0..3 {
            case.d_image[channel * pixels + i] = upstream.color[channel] as f32;
        }
    }
    let gradients = isect_backward(&lists.screen, grid, background, &thresholds, &upstream);
    for isect in &lists.isects {
        let screen = lists.screen[isect.splat as usize].as_ref();
        let sums = match (screen, gradients.get(isect)) {
            (Some(screen), Some(gradient)) => pack::whitened_sums(screen, gradient),
            _ => [0.0; 9],
        };
        for (column, sum) in case.sums.iter_mut().zip(sums) {
            column.push(sum);
        }
    }
    case
}

/// The columns' names, in the order of `whitened_sums`.
pub(crate) const NAMES: [&str; 9] = [
    "s", "s x", "s y", "s xx", "s xy", "s yy", "red", "green", "blue",
];

#[test]
fn every_intersection_gets_its_gradient() {
    let gpu = device::gpu();
    let mut check = Check::new("rasterize_backward");
    let cases: Vec<_> = cases()
        .into_iter()
        .map(|(name, scene)| {
            let lists = Lists::new(&scene);
            let case = prepare(&scene, &lists);
            (name, scene, lists, case)
        })
        .collect();
    for choice in lane_choices!(rasterize_backward, gpu) {
        let kernel = RasterizeBackward::new(&gpu, choice).unwrap();
        for (name, scene, lists, case) in &cases {
            let sources = lists.isects.len();
            let shape = unwritten::<[f32; 4]>(&gpu, sources);
            let tone = unwritten::<[f32; 4]>(&gpu, sources);
            let rest = unwritten::<f32>(&gpu, sources);
            let (shapes, tones, rests) = pack::arrays(&lists.records);
            let io = Bindings {
                view: &buffer(&gpu, &[view(scene)]),
                range_from_tile: &buffer(&gpu, &lists.range_from_tile),
                emitted_from_isect: &buffer(&gpu, &lists.emitted_from_isect),
                splat_from_emitted: &buffer(&gpu, &lists.splat_from_emitted()),
                ellipse_from_splat: &buffer(&gpu, &shapes),
                whiten_rg_from_splat: &buffer(&gpu, &tones),
                blue_depth_from_splat: &buffer(&gpu, &rests),
                image: &buffer(&gpu, &case.image),
                d_image: &buffer(&gpu, &case.d_image),
                isect_end_from_pixel: &buffer(&gpu, &case.ends),
                d_shape_from_source: &shape,
                d_tone_from_source: &tone,
                d_rest_from_source: &rest,
            };
            let tiles = lists.grid.len() as usize;
            let params = Params {
                tile_stride: 1,
                band: 0,
            };
            gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(tiles as u32)))
                .unwrap();
            let (shape, tone) = (floats(&read(&gpu, &shape)), floats(&read(&gpu, &tone)));
            let rest = floats(&read(&gpu, &rest));
            let found = |quantity: usize| -> Vec<f64> {
                let value = |i: usize| match quantity {
                    0..4 => shape[4 * i + quantity],
                    4..8 => tone[4 * i + quantity - 4],
                    _ => rest[i],
                };
                (0..sources).map(value).collect()
            };
            // Next to the cap a float knows an alpha's complement to 4 parts in a thousand. A whole frame, whose
            // passes share their alphas, does not feel that; the transmittance given here is the oracle's.
            let tolerance = if *name == "capped" { 6e-3 } else { 1e-4 };
            // Terms of a sum over 128 pixels carry the error of alpha (2e-5, see `rasterize`) and of the
            // transmittance that is regained by one division per splat, 2u each; upstream signs alternate,
            // so sums are smaller than their terms by about sqrt(128), and residuals contribution up to 3.3 squared.
            // What is small beside the typical sum is judged by that.
            let outputs = (0..9).map(|quantity| {
                let expected = case.sums[quantity].clone();
                let scale = rms(&expected).max(1e-6);
                Output::relative(NAMES[quantity], found(quantity), expected, tolerance, scale)
            });
            let case = format!("{name}, {choice:?}");
            check.outputs(&case, outputs.collect());
        }
    }
    check.finish();
}
