//! Case of `prune_limit`: how far down a ranking of splats each pixel can do without them.

use super::KernelCase;
use super::composite::{Composite, CompositeBuffers};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::prune_limit::{self, Choice, Params, PruneLimit};
use crate::kernels::walker_bindings;
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::random::Random;
use crate::reference::Thresholds;
use crate::reference::frame::depth_order;
use crate::reference::prune_limit::{PruneLimits, prune_limit as reference};
use crate::reference::rasterize::weights;
use crate::render::tile_stride;
use rayon::prelude::*;

/// Steps of a whole search.
const STEPS: [f32; 4] = [64.0, 16.0, 4.0, 1.0];

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

/// A search by pixel: the budget is that of the pixels that lose something, times a number.
pub fn prune_limit<'a>(gpu: &Gpu, composite: &'a Composite, budget: f32) -> Result<KernelCase<'a, PruneLimit>> {
    let (pixels, wide) = (composite.pixels.len(), f64::from(budget));
    let ranks = ranks(composite.scene.splats.len());
    let splat_from_rank = depth_order(&composite.lists.screen);
    let limits = |pixel| {
        let (tile, at) = composite.place(pixel);
        let listed = &composite.ranks_from_tile[tile];
        let weights = weights(&composite.splats, listed, at, &Thresholds::ENGINE);
        let ranked = |&(place, weight): &(usize, f64)| (f64::from(ranks[splat_from_rank[place]]), weight);
        reference(&weights.iter().map(ranked).collect::<Vec<_>>(), wide)
    };
    let expected: Vec<PruneLimits> = (0..pixels).into_par_iter().map(limits).collect();
    let input = CompositeBuffers::new(gpu, composite)?;
    let ranks = gpu.buffer_from("rank_from_splat", &ranks)?;
    let limit = gpu.buffer::<f32>("limit_from_pixel", pixels)?;
    let spent = gpu.buffer::<f32>("spent_from_pixel", pixels)?;
    let near = || composite.pixels.iter().map(|pixel| pixel.near);
    // The weights that make up a sum err by 2e-5 of what there is at most (see `contribution`); a budget within so
    // much of a sum may be met or not.
    let unsure = |(near, limits): (bool, &PruneLimits)| near || limits.margin < 2e-5 / wide;
    let unsure: Vec<bool> = near().zip(&expected).map(unsure).collect();
    // A search that begins with what is beyond its budget finds nothing to add to it.
    let limits = expected.iter().map(|limits| match limits.spent > wide {
        true => 0.0,
        false => limits.limit,
    });
    let limits: Vec<f64> = limits.collect();
    let sums: Vec<f64> = expected.iter().map(|limits| limits.spent).collect();
    let outputs = composite.kernel_outputs();
    let case = KernelCase::new(composite.work())
        .tune(move |choice: &mut Choice| *choice = choice.of_outputs(outputs))
        .compare(&limit, move |found| {
            let limit = Output::exact("limit", floats(&found), limits.clone());
            vec![limit.near(unsure.clone(), f64::INFINITY, 0.05)]
        })
        .fill(&limit, 0)
        .compare(&spent, move |found| {
            let spent = Output::relative("spent", floats(&found), sums.clone(), 2e-5, 1.0);
            vec![spent.near(near().collect(), 2.0 / 255.0, 0.02)]
        });
    Ok(case.commands(move |rec, kernel: &PruneLimit, _| {
        let io = walker_bindings! {
            prune_limit, input, &input.emitted_from_isect;
            rank_from_splat: &ranks,
            limit_from_pixel: &limit,
            spent_from_pixel: &spent,
            blue_depth_from_splat: &input.blue_depth_from_splat,
            plane_from_splat: &input.plane_from_splat,
        };
        for step in STEPS {
            let params = Params {
                tile_stride: tile_stride(input.tiles),
                step,
                budget,
            };
            kernel.record(rec, io, params, input.groups());
        }
    }))
}
