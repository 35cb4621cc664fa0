//! Highest prune rank of each pixel with a summed weight within the budget.

use crate::common::check::*;
use crate::common::lists::{Lists, view};
use crate::common::scenes::{Random, Scene};
use crate::common::{device, pack};
use crate::kernels::contribution::{in_order, near};
use crate::kernels::lane_choices;
use crate::kernels::rasterize::cases;
use ashfall::gpu::{Gpu, Groups};
use ashfall::kernels::prune_limit::{Bindings, Params, PruneLimit};
use ashfall::reference::Thresholds;
use ashfall::reference::contribution::weights;
use ashfall::reference::frame::{center, depth_order};
use ashfall::reference::prune_limit::{PruneLimits, prune_limit};

/// Ranks by splat: some gone, some that stay, most between; several of one rank.
fn ranks(count: usize) -> Vec<f32> {
    let random = &mut Random::new(count as u64);
    let rank = |_| match random.below(10) {
        0 => 0.0,
        1 => 1e9,
        _ => 1.0 + random.below(255) as f32,
    };
    (0..count).map(rank).collect()
}

/// By pixel, what can be afforded: the budget is that of the pixels that lose something, times a number.
fn expected(lists: &Lists, ranks: &[f32], budget: f64) -> Vec<PruneLimits> {
    let splats = in_order(lists);
    let order: Vec<usize> = (0..splats.len()).collect();
    let splat_from_rank = depth_order(&lists.screen);
    let width = lists.grid.width as usize;
    (0..width * lists.grid.height as usize)
        .map(|i| {
            let weights = weights(&splats, &order, center(i, width), &Thresholds::ENGINE);
            let ranked: Vec<(f64, f64)> = weights
                .iter()
                .map(|&(place, weight)| (f64::from(ranks[splat_from_rank[place]]), weight))
                .collect();
            prune_limit(&ranked, budget)
        })
        .collect()
}

fn run(
    gpu: &Gpu,
    kernel: &PruneLimit,
    (scene, lists): (&Scene, &Lists),
    ranks: &[f32],
    budget: f32,
) -> (Vec<f32>, Vec<f32>) {
    let pixels = (lists.grid.width * lists.grid.height) as usize;
    let (shapes, tones, _) = pack::arrays(&lists.records);
    let limits = buffer(gpu, &vec![0.0f32; pixels]);
    let spent = unwritten::<f32>(gpu, pixels);
    let io = Bindings {
        view: &buffer(gpu, &[view(scene)]),
        range_from_tile: &buffer(gpu, &lists.range_from_tile),
        emitted_from_isect: &buffer(gpu, &lists.emitted_from_isect),
        splat_from_emitted: &buffer(gpu, &lists.splat_from_emitted()),
        ellipse_from_splat: &buffer(gpu, &shapes),
        whiten_rg_from_splat: &buffer(gpu, &tones),
        rank_from_splat: &buffer(gpu, ranks),
        limit_from_pixel: &limits,
        spent_from_pixel: &spent,
    };
    let tiles = lists.grid.len() as usize;
    gpu.run(|rec| {
        for step in [64.0, 16.0, 4.0, 1.0] {
            let params = Params {
                tile_stride: 1,
                step,
                budget,
            };
            kernel.record(rec, io, params, Groups::Count(tiles as u32));
        }
    })
    .unwrap();
    (read(gpu, &limits), read(gpu, &spent))
}

#[test]
fn pixels_find_how_far_they_can_go() {
    let gpu = device::gpu();
    let mut check = Check::new("prune_limit");
    let cases: Vec<_> = cases()
        .into_iter()
        .map(|(name, scene)| {
            let lists = Lists::new(&scene);
            let ranks = ranks(scene.splats.len());
            let near = near(&lists);
            (name, scene, lists, ranks, near)
        })
        .collect();
    for choice in lane_choices!(prune_limit, gpu) {
        let kernel = PruneLimit::new(&gpu, choice).unwrap();
        for (name, scene, lists, ranks, near) in &cases {
            for budget in [0.003f32, 0.3] {
                let wanted = expected(lists, ranks, f64::from(budget));
                // The weights that make up a sum err by 2e-5 of what there is at most (see `contribution`); a budget
                // within so much of a sum may be met or not.
                let margin = 2e-5 / f64::from(budget);
                let unsure =
                    |(near, afforded): (&bool, &PruneLimits)| *near || afforded.margin < margin;
                let unsure: Vec<bool> = near.iter().zip(&wanted).map(unsure).collect();
                // A search that begins with what is beyond its budget finds nothing to add to it.
                let limits = wanted.iter().map(|a| match a.spent > f64::from(budget) {
                    true => 0.0,
                    false => a.limit,
                });
                let spent = wanted.iter().map(|a| a.spent).collect();
                let (limit_found, spent_found) = run(&gpu, &kernel, (scene, lists), ranks, budget);
                let outputs = vec![
                    Output::exact("limit", floats(&limit_found), limits.collect()).near(
                        unsure,
                        f64::INFINITY,
                        0.05,
                    ),
                    Output::relative("spent", floats(&spent_found), spent, 2e-5, 1.0).near(
                        near.clone(),
                        2.0 / 255.0,
                        0.02,
                    ),
                ];
                check.outputs(&format!("{name}, {budget}, {choice:?}"), outputs);
            }
        }
    }
    check.finish();
}

/// Pixels whose limit is raised never lose more than they may, by the very sums that a frame without the ranks up
/// to it takes: 5,000 rankings of one stack.
#[test]
fn what_a_limit_allows_is_within_the_budget() {
    let random = &mut Random::new(3);
    for round in 0..5000 {
        let count = 1 + random.below(12);
        let mut passing = 1.0;
        let weights: Vec<(f64, f64)> = (0..count)
            .map(|_| {
                let alpha = random.between(0.0, 0.4);
                let weight = passing * alpha;
                passing -= weight;
                ((1 + random.below(255)) as f64, weight)
            })
            .collect();
        let budget = random.between(0.001, 0.8);
        let PruneLimits { limit, .. } = prune_limit(&weights, budget);
        let sum = |limit: f64| -> f64 {
            let taken = weights.iter().filter(|(rank, _)| *rank <= limit);
            taken.map(|(_, weight)| weight).sum()
        };
        assert!(sum(limit) <= budget + 1e-12, "round {round}");
        assert!(
            limit == 255.0 || sum(limit + 1.0) > budget - 1e-12,
            "round {round}"
        );
    }
}
