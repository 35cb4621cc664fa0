//! What pixels would lose with their splats, what they can prune_limit to lose, and what a splat comes to.

use super::composite::{Composite, INPUTS, Input, LANES};
use super::{ELEMENTWISE, counts, nothing, read, wanted};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::kernels::{contribution, prune_limit, sum_by_splat};
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::{Bench, Unit, Work};
use crate::reference::Thresholds;
use crate::reference::contribution::{Loss, weights};
use crate::reference::prune_limit::prune_limit as affordable;
use crate::render::tile_stride;
use rayon::prelude::*;

/// What pixels may lose here: some of their splats, not all.
const BUDGET: f32 = 0.05;

/// Steps of a whole search.
const STEPS: [f32; 4] = [64.0, 16.0, 4.0, 1.0];

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for (name, count, size, sigma) in INPUTS {
        let none = Work::default();
        let is_wanted = !wanted!(bench, contribution, name, LANES, none).is_empty()
            || !wanted!(bench, prune_limit, name, LANES, none).is_empty()
            || !wanted!(bench, sum_by_splat, name, ELEMENTWISE, none).is_empty();
        if is_wanted {
            let composite = Composite::new(count, size, sigma);
            let input = Input::new(bench.gpu(), &composite)?;
            let case = Scales::new(bench.gpu(), &composite)?;
            weighing(bench, name, &composite, &input, &case)?;
            affording(bench, name, &composite, &input, &case)?;
            tallying(bench, name, &composite, &case)?;
        }
    }
    Ok(())
}

/// What there is to contribution by, and what should come of it.
struct Scales {
    spent: Buffer<f32>,
    limit: Buffer<f32>,
    ranks: Buffer<f32>,
    records: Buffer<[f32; 3]>,
    /// By source.
    losses: Vec<Loss>,
    /// By source: whether its tile has a pixel near a threshold.
    near: Vec<bool>,
    /// By pixel: rank and weight of what it blends.
    ranked: Vec<Vec<(f64, f64)>>,
}

impl Scales {
    fn new(gpu: &Gpu, composite: &Composite) -> Result<Scales> {
        let pixels = composite.pixels.len();
        let lists = &composite.lists;
        let order = crate::reference::frame::depth_order(&lists.screen);
        let rank = |splat: usize| (splat * 7919 % 300) as f32;
        let spent = |pixel: usize| (pixel % 7) as f32 * 1e-3;
        let limit = |pixel: usize| (pixel % 256) as f32;
        let blended: Vec<Vec<(usize, f64)>> = (0..pixels)
            .into_par_iter()
            .map(|pixel| {
                let (tile, at) = composite.place(pixel);
                let ranks = &composite.ranks_from_tile[tile];
                weights(&composite.splats, ranks, at, &Thresholds::ENGINE)
            })
            .collect();
        let mut losses = vec![Loss::NOTHING; lists.isects.len()];
        let mut near_tile = vec![false; lists.range_from_tile.len()];
        for (pixel, blended) in blended.iter().enumerate() {
            let (tile, _) = composite.place(pixel);
            near_tile[tile] |= composite.pixels[pixel].near;
            let ranks = &composite.ranks_from_tile[tile];
            let begin = lists.range_from_tile[tile][0] as usize;
            for &(place, weight) in blended {
                let isect = begin + ranks.partition_point(|&r| r < place);
                let loss = &mut losses[lists.emitted_from_isect[isect] as usize];
                *loss = loss.and(weight, f64::from(spent(pixel)), f64::from(limit(pixel)));
            }
        }
        let ranked = |blended: &Vec<(usize, f64)>| {
            let pairs = blended.iter();
            pairs
                .map(|&(place, weight)| (f64::from(rank(order[place])), weight))
                .collect()
        };
        let of = |values: Vec<f32>| gpu.buffer_from("by pixel", &values);
        Ok(Scales {
            spent: of((0..pixels).map(spent).collect())?,
            limit: of((0..pixels).map(limit).collect())?,
            ranks: of((0..composite.scene.splats.len()).map(rank).collect())?,
            records: gpu.buffer("records", lists.isects.len())?,
            near: lists
                .isects
                .iter()
                .map(|isect| near_tile[isect.tile as usize])
                .collect(),
            ranked: blended.iter().map(ranked).collect(),
            losses,
        })
    }

    /// Tolerances and shares are those of the kernel's test.
    fn records(&self, gpu: &Gpu) -> Result<Vec<Output>> {
        let found = read(gpu, &self.records)?;
        let column = |i: usize| found.iter().map(|r| f64::from(r[i])).collect::<Vec<_>>();
        let wanted = |of: fn(&Loss) -> f64| self.losses.iter().map(of).collect::<Vec<_>>();
        let most = Output::relative("most", column(0), wanted(|l| l.most), 2e-5, 1.0);
        let sum = Output::relative("sum", column(1), wanted(|l| l.sum), 2e-5, 128.0);
        let limits = wanted(|l| l.limit.min(f64::from(3.4e38_f32)));
        let limit = Output::exact("limit", column(2), limits);
        let (near, jump) = (|| self.near.clone(), 2.0 / 255.0);
        Ok(vec![
            most.near(near(), jump, 0.02),
            sum.near(near(), 128.0 * jump, 0.02),
            limit.near(near(), f64::INFINITY, 0.02),
        ])
    }
}

fn weighing(
    bench: &mut Bench,
    name: &str,
    composite: &Composite,
    input: &Input,
    case: &Scales,
) -> Result<()> {
    let gpu = bench.gpu().clone();
    for (variant, workgroup, trial) in wanted!(bench, contribution, name, LANES, composite.work()) {
        if !gpu.caps().lanes_fit(variant.info(), workgroup) {
            continue;
        }
        let spec = contribution::Spec {
            workgroup,
            ..contribution::Spec::default()
        };
        let kernel = contribution::Contribution::new(&gpu, contribution::Choice { variant, spec })?;
        let io = contribution::Bindings {
            view: &input.view,
            range_from_tile: &input.range_from_tile,
            emitted_from_isect: &input.emitted_from_isect,
            splat_from_emitted: &input.splat_from_emitted,
            ellipse_from_splat: &input.records.shape,
            whiten_rg_from_splat: &input.records.tone,
            spent_from_pixel: &case.spent,
            limit_from_pixel: &case.limit,
            record_from_emitted: &case.records,
        };
        let params = contribution::Params {
            tile_stride: tile_stride(input.tiles),
        };
        let record = |rec: &mut crate::gpu::Recorder<'_>| {
            kernel.record(rec, io, params, input.groups());
        };
        bench.trial(&trial, nothing, record, || case.records(&gpu))?;
    }
    Ok(())
}

fn affording(
    bench: &mut Bench,
    name: &str,
    composite: &Composite,
    input: &Input,
    case: &Scales,
) -> Result<()> {
    let gpu = bench.gpu().clone();
    let pixels = composite.pixels.len();
    let budget = f64::from(BUDGET);
    // A weight errs by 2e-5 of what there is; a budget within so much of a sum may be met or not.
    let unsure = |margin: f64, pixel: usize| composite.pixels[pixel].near || margin < 2e-5 / budget;
    let (limits, spent): (Buffer<f32>, Buffer<f32>) =
        (gpu.buffer("limits", pixels)?, gpu.buffer("spent", pixels)?);
    for (variant, workgroup, trial) in wanted!(bench, prune_limit, name, LANES, composite.work()) {
        if !gpu.caps().lanes_fit(variant.info(), workgroup) {
            continue;
        }
        let spec = prune_limit::Spec {
            workgroup,
            ..prune_limit::Spec::default()
        };
        let kernel = prune_limit::PruneLimit::new(&gpu, prune_limit::Choice { variant, spec })?;
        let io = prune_limit::Bindings {
            view: &input.view,
            range_from_tile: &input.range_from_tile,
            emitted_from_isect: &input.emitted_from_isect,
            splat_from_emitted: &input.splat_from_emitted,
            ellipse_from_splat: &input.records.shape,
            whiten_rg_from_splat: &input.records.tone,
            rank_from_splat: &case.ranks,
            limit_from_pixel: &limits,
            spent_from_pixel: &spent,
        };
        let record = |rec: &mut crate::gpu::Recorder<'_>| {
            for step in STEPS {
                let params = prune_limit::Params {
                    tile_stride: tile_stride(input.tiles),
                    step,
                    budget: BUDGET,
                };
                kernel.record(rec, io, params, input.groups());
            }
        };
        let outputs = || {
            let wanted: Vec<_> = case.ranked.iter().map(|r| affordable(r, budget)).collect();
            let near = wanted.iter().enumerate().map(|(i, a)| unsure(a.margin, i));
            let limit = |a: &crate::reference::prune_limit::PruneLimits| match a.spent > budget {
                true => 0.0,
                false => a.limit,
            };
            let found = floats(&read(&gpu, &limits)?);
            let limit = Output::exact("limit", found, wanted.iter().map(limit).collect());
            Ok(vec![limit.near(near.collect(), f64::INFINITY, 0.05)])
        };
        bench.trial(&trial, |rec| rec.fill(&limits, 0), record, outputs)?;
    }
    Ok(())
}

fn tallying(bench: &mut Bench, name: &str, composite: &Composite, case: &Scales) -> Result<()> {
    let gpu = bench.gpu().clone();
    let lists = &composite.lists;
    let splats = composite.scene.splats.len();
    let (mut tiles, mut begins) = (vec![0u32; splats], vec![0u32; splats]);
    for (source, isect) in lists.isects.iter().enumerate().rev() {
        tiles[isect.splat as usize] += 1;
        begins[isect.splat as usize] = source as u32;
    }
    let records: Vec<[f32; 3]> = (0..lists.isects.len())
        .map(|i| [i % 3, i % 5, i % 7].map(|x| x as f32))
        .collect();
    gpu.upload(&case.records, 0, &records)?;
    let (tiles, begins) = (
        gpu.buffer_from("tiles", &tiles)?,
        gpu.buffer_from("begins", &begins)?,
    );
    let counts = counts(&gpu, &[])?;
    let totals: Buffer<[f32; 3]> = gpu.buffer("totals", splats)?;
    let work = Work::of(splats, Unit::Splats).moving(12 * lists.isects.len() + 32 * splats);
    for (variant, workgroup, trial) in wanted!(bench, sum_by_splat, name, ELEMENTWISE, work) {
        let spec = sum_by_splat::Spec {
            workgroup,
            ..sum_by_splat::Spec::default()
        };
        let kernel = sum_by_splat::SumBySplat::new(&gpu, sum_by_splat::Choice { variant, spec })?;
        let io = sum_by_splat::Bindings {
            counts: &counts,
            tile_count_from_splat: &tiles,
            emitted_from_splat: &begins,
            record_from_emitted: &case.records,
            sum_from_splat: &totals,
        };
        let params = sum_by_splat::Params {
            splat_count: splats as u32,
        };
        let outputs = || {
            let mut sums = vec![0.0; splats];
            for (isect, record) in lists.isects.iter().zip(&records) {
                sums[isect.splat as usize] += f64::from(record[1]);
            }
            let found = read(&gpu, &totals)?;
            let column = found.iter().map(|r| f64::from(r[1])).collect();
            Ok(vec![Output::exact("sum", column, sums)])
        };
        bench.trial(
            &trial,
            |rec| rec.fill(&totals, 0),
            |rec| kernel.record(rec, io, params, kernel.groups(splats)),
            outputs,
        )?;
    }
    Ok(())
}
