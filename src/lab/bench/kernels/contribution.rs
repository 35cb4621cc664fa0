//! Case of `contribution`: loss of a tile's pixels without each of its splats.

use super::KernelCase;
use super::composite::{Composite, CompositeBuffers};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::kernels::contribution::{self, Choice, Contribution, Params};
use crate::kernels::walker_bindings;
use crate::lab::bench::check::Output;
use crate::lab::bench::input::random::Random;
use crate::reference::Thresholds;
use crate::reference::contribution::Loss;
use crate::reference::rasterize::weights;
use crate::render::tile_stride;

/// The limit that stands for none, as the shader has it.
const NONE: f64 = 3.4e38_f32 as f64;

/// Random spent weights and limits by pixel.
pub fn contribution<'a>(gpu: &Gpu, composite: &'a Composite) -> Result<KernelCase<'a, Contribution>> {
    let records = gpu.buffer("record_from_emitted", composite.lists.isects.len())?;
    contribution_into(gpu, composite, &records)
}

/// The same with the records in a given buffer.
pub fn contribution_into<'a>(
    gpu: &Gpu,
    composite: &'a Composite,
    records: &Buffer<[f32; 3]>,
) -> Result<KernelCase<'a, Contribution>> {
    let pixels = composite.pixels.len();
    let random = &mut Random::new(pixels as u64);
    let spent: Vec<f32> = (0..pixels).map(|_| random.between(0.0, 0.01) as f32).collect();
    let limit: Vec<f32> = (0..pixels).map(|_| random.below(256) as f32).collect();
    let mut losses = vec![Loss::NOTHING; composite.lists.isects.len()];
    composite.fold_sources(
        |_, ranks, at| weights(&composite.splats, ranks, at, &Thresholds::ENGINE),
        |source, pixel, weight| {
            let budget = (f64::from(spent[pixel]), f64::from(limit[pixel]));
            losses[source] = losses[source].and(*weight, budget.0, budget.1);
        },
    );
    let input = CompositeBuffers::new(gpu, composite)?;
    let spent = gpu.buffer_from("spent_from_pixel", &spent)?;
    let limit = gpu.buffer_from("limit_from_pixel", &limit)?;
    let outputs = composite.kernel_outputs();
    let case = KernelCase::new(composite.work()).tune(move |choice: &mut Choice| *choice = choice.of_outputs(outputs));
    let case = case.compare(records, move |found| {
        let column = |i: usize| found.iter().map(|r| f64::from(r[i])).collect::<Vec<_>>();
        let wanted = |of: fn(&Loss) -> f64| losses.iter().map(of).collect::<Vec<_>>();
        let near = || composite.near_sources();
        // Weights err as pixels of `rasterize` do, 2e-5 of what there is at most, and a sum has 128 of them. Where an
        // alpha meets its threshold, one weight of 1/255 comes or goes, and as much changes behind it.
        let (tolerance, jump) = (2e-5, 2.0 / 255.0);
        let most = Output::relative("most", column(0), wanted(|l| l.most), tolerance, 1.0);
        let sum = Output::relative("sum", column(1), wanted(|l| l.sum), tolerance, 128.0);
        let limit = Output::exact("limit", column(2), wanted(|l| l.limit.min(NONE)));
        vec![
            most.near(near(), jump, 0.02),
            sum.near(near(), 128.0 * jump, 0.02),
            limit.near(near(), f64::INFINITY, 0.02),
        ]
    });
    let records = records.clone();
    Ok(case.commands(move |rec, kernel: &Contribution, _| {
        let io = walker_bindings! {
            contribution, input, &input.emitted_from_isect;
            spent_from_pixel: &spent,
            limit_from_pixel: &limit,
            record_from_emitted: &records,
            blue_depth_from_splat: &input.blue_depth_from_splat,
            plane_from_splat: &input.plane_from_splat,
        };
        let params = Params {
            tile_stride: tile_stride(input.tiles),
        };
        kernel.record(rec, io, params, input.groups());
    }))
}
