//! Contribution of each splat of a tile's list to the tile's pixels.

use crate::common::check::*;
use crate::common::lists::{Lists, view};
use crate::common::scenes::{self, Random, Scene};
use crate::common::{device, pack};
use crate::kernels::lane_choices;
use crate::kernels::rasterize::cases;
use ashfall::gpu::{DeviceKind, Gpu, Groups};
use ashfall::kernels::contribution::{Bindings, Contribution, Params};
use ashfall::reference::contribution::{Loss, contribution};
use ashfall::reference::frame::{center, depth_order};
use ashfall::reference::rasterize::discontinuity_margin;
use ashfall::reference::{ScreenSplat, Thresholds};
use ashfall::render::list_limit;
use std::collections::BTreeSet;

/// The limit that stands for none, as the shader has it.
const NONE: f64 = 3.4e38_f32 as f64;

/// The splats in the order of depth.
pub(crate) fn in_order(lists: &Lists) -> Vec<ScreenSplat<f64>> {
    let order = depth_order(&lists.screen);
    order.iter().filter_map(|&i| lists.screen[i]).collect()
}

/// Which pixels rounding may carry across a threshold of compositing.
pub(crate) fn near(lists: &Lists) -> Vec<bool> {
    let splats = in_order(lists);
    let order: Vec<usize> = (0..splats.len()).collect();
    let pixels = 0..(lists.grid.width * lists.grid.height) as usize;
    pixels
        .map(|i| {
            let at = center(i, lists.grid.width as usize);
            discontinuity_margin(&splats, &order, at, &Thresholds::ENGINE).nearest() < 1e-4
        })
        .collect()
}

/// By source: whether a pixel of its tile is one of those.
pub(crate) fn in_tiles(lists: &Lists, pixels: &[bool]) -> Vec<bool> {
    let width = lists.grid.width as usize;
    let tile = |i: usize| lists.grid.tile_from_position(center(i, width));
    let tiles: BTreeSet<u32> = (0..pixels.len()).filter(|&i| pixels[i]).map(tile).collect();
    let isects = lists.isects.iter();
    isects.map(|isect| tiles.contains(&isect.tile)).collect()
}

struct Case {
    name: &'static str,
    scene: Scene,
    lists: Lists,
    spent: Vec<f32>,
    limit: Vec<f32>,
    /// By source.
    expected: Vec<Loss>,
    /// By source: whether a pixel of its tile is near a threshold.
    near: Vec<bool>,
}

fn case((name, scene): (&'static str, Scene)) -> Case {
    let lists = Lists::new(&scene);
    let pixels = (lists.grid.width * lists.grid.height) as usize;
    let random = &mut Random::new(pixels as u64);
    let spent: Vec<f32> = (0..pixels)
        .map(|_| random.between(0.0, 0.01) as f32)
        .collect();
    let limit: Vec<f32> = (0..pixels).map(|_| random.below(256) as f32).collect();
    let wide = |values: &[f32]| values.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
    let losses = contribution(
        &lists.screen,
        &lists.grid,
        &Thresholds::ENGINE,
        &wide(&spent),
        &wide(&limit),
    );
    let of = |isect| losses.get(isect).copied().unwrap_or(Loss::NOTHING);
    Case {
        expected: lists.isects.iter().map(of).collect(),
        near: in_tiles(&lists, &near(&lists)),
        name,
        scene,
        lists,
        spent,
        limit,
    }
}

fn run(gpu: &Gpu, kernel: &Contribution, case: &Case, slices: &[[u32; 2]]) -> Vec<[f32; 3]> {
    let lists = &case.lists;
    let (shapes, tones, _) = pack::arrays(&lists.records);
    let records = unwritten::<[f32; 3]>(gpu, lists.isects.len());
    let io = Bindings {
        view: &buffer(gpu, &[view(&case.scene)]),
        range_from_tile: &buffer(gpu, slices),
        emitted_from_isect: &buffer(gpu, &lists.emitted_from_isect),
        splat_from_emitted: &buffer(gpu, &lists.splat_from_emitted()),
        ellipse_from_splat: &buffer(gpu, &shapes),
        whiten_rg_from_splat: &buffer(gpu, &tones),
        spent_from_pixel: &buffer(gpu, &case.spent),
        limit_from_pixel: &buffer(gpu, &case.limit),
        record_from_emitted: &records,
    };
    let tiles = lists.grid.len() as usize;
    gpu.run(|rec| {
        kernel.record(
            rec,
            io,
            Params { tile_stride: 1 },
            Groups::Count(tiles as u32),
        )
    })
    .unwrap();
    read(gpu, &records)
}

#[test]
fn every_pair_is_weighed() {
    let gpu = device::gpu();
    let mut check = Check::new("contribution");
    let cases: Vec<Case> = cases().into_iter().map(case).collect();
    for choice in lane_choices!(contribution, gpu) {
        let kernel = Contribution::new(&gpu, choice).unwrap();
        for case in &cases {
            let found = run(&gpu, &kernel, case, &case.lists.range_from_tile);
            let column = |i: usize| found.iter().map(|r| f64::from(r[i])).collect::<Vec<_>>();
            let wanted = |of: fn(&Loss) -> f64| case.expected.iter().map(of).collect::<Vec<_>>();
            // Weights err as pixels of `rasterize` do, 2e-5 of what there is at most, and a sum has 128 of them. Where
            // an alpha meets its threshold, one weight of 1/255 comes or goes, and as much changes behind it.
            let (tolerance, jump) = (2e-5, 2.0 / 255.0);
            let near = || case.near.clone();
            let outputs = vec![
                Output::relative("most", column(0), wanted(|l| l.most), tolerance, 1.0).near(
                    near(),
                    jump,
                    0.02,
                ),
                Output::relative("sum", column(1), wanted(|l| l.sum), tolerance, 128.0).near(
                    near(),
                    128.0 * jump,
                    0.02,
                ),
                Output::exact("limit", column(2), wanted(|l| l.limit.min(NONE))).near(
                    near(),
                    f64::INFINITY,
                    0.02,
                ),
            ];
            let name = format!("{}, {choice:?}", case.name);
            check.outputs(&name, outputs);
        }
    }
    check.finish();
}

#[test]
fn variants_agree_to_the_last_bit_of_maxima() {
    let gpu = device::gpu();
    let case = case(("hard", scenes::hard(16, 90, 33, 47, 0)));
    let runs: Vec<Vec<[u32; 2]>> = lane_choices!(contribution, gpu)
        .map(|choice| {
            let kernel = Contribution::new(&gpu, choice).unwrap();
            let found = run(&gpu, &kernel, &case, &case.lists.range_from_tile);
            found
                .iter()
                .map(|r| [r[0].to_bits(), r[2].to_bits()])
                .collect()
        })
        .collect();
    assert!(runs.windows(2).all(|two| two[0] == two[1]));
}

#[test]
fn a_list_as_long_as_allowed_is_weighed_to_its_end() {
    let gpu = device::gpu();
    let len = list_limit(DeviceKind::Cpu) as usize;
    // So many splats over one tile, so small and faint that what passes them all is far above the stop.
    let mut scene = scenes::gentle(5, 230_000, 8, 16, 0);
    scene.splats.opacity_logit.fill(-5.28);
    scene.splats.log_scale.fill([-9.0; 3]);
    let lists = Lists::new(&scene);
    assert!(lists.range_from_tile[0][1] as usize >= len);
    let count = lists.isects.len();
    let case = Case {
        name: "a long list",
        scene,
        lists,
        spent: vec![0.0; 128],
        limit: vec![7.0; 128],
        expected: Vec::new(),
        near: Vec::new(),
    };
    for choice in lane_choices!(contribution, gpu) {
        let kernel = Contribution::new(&gpu, choice).unwrap();
        let found = run(&gpu, &kernel, &case, &[[0, len as u32]]);
        assert_eq!(found.len(), count);
        // One in this scene is seen by a pixel or two; it counts there and has its limit.
        let sources = &case.lists.emitted_from_isect[len - 100..len];
        let seen = |&&source: &&u32| {
            let [most, sum, limit] = found[source as usize];
            most > 0.0 && sum >= most && limit == 7.0
        };
        assert_eq!(sources.iter().filter(seen).count(), 100, "{choice:?}");
    }
}
