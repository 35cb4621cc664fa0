//! Compositing by the rules of the 3DGS code, over the engine's own lists.

use super::composite::{Composite, INPUTS, Input};
use super::{nothing, read, wanted};
use crate::Result;
use crate::kernels::rasterize_inria::{Bindings, Choice, Params, RasterizeInria};
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::{Bench, Unit, Work};
use crate::reference;
use crate::render::tile_stride;
use rayon::prelude::*;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for (name, count, size, sigma) in INPUTS {
        if !wanted!(bench, rasterize_inria, name, [0], Work::default()).is_empty() {
            composite(bench, name, &Composite::new(count, size, sigma))?;
        }
    }
    Ok(())
}

/// What a pixel should be: red, green, blue, transmittance; how many splats it blends; and how near it is to a
/// threshold, relatively.
fn expected_at(input: &Composite, pixel: usize) -> ([f64; 4], usize, f64) {
    let (tile, at) = input.place(pixel);
    let ranks = &input.ranks_from_tile[tile];
    let listed = ranks.iter().map(|&rank| &input.splats[rank]);
    let (shown, blended, nearest) =
        reference::rasterize_inria::over(listed, at, input.background());
    let [red, green, blue] = shown.color;
    ([red, green, blue, shown.transmittance], blended, nearest)
}

fn bindings(input: &Input) -> Bindings<'_> {
    Bindings {
        view: &input.view,
        range_from_tile: &input.range_from_tile,
        emitted_from_isect: &input.emitted_from_isect,
        splat_from_emitted: &input.splat_from_emitted,
        ellipse_from_splat: &input.records.shape,
        whiten_rg_from_splat: &input.records.tone,
        blue_depth_from_splat: &input.records.rest,
        image: &input.image,
        depth: &input.depth,
        isect_end_from_pixel: &input.isect_end_from_pixel,
    }
}

fn composite(bench: &mut Bench, name: &str, shown: &Composite) -> Result<()> {
    let gpu = bench.gpu().clone();
    let input = Input::new(&gpu, shown)?;
    let pixels: Vec<_> = (0..shown.pixels.len())
        .into_par_iter()
        .map(|pixel| expected_at(shown, pixel))
        .collect();
    let plane = |i: usize| pixels.iter().map(move |(planes, ..)| planes[i]);
    let planes: Vec<f64> = (0..4).flat_map(plane).collect();
    let near: Vec<bool> = pixels
        .iter()
        .map(|&(.., nearest)| nearest <= 1e-4)
        .collect();
    let near = near.repeat(4);
    let pairs = pixels.iter().map(|&(_, blended, _)| blended).sum();
    let params = Params {
        tile_stride: tile_stride(input.tiles),
    };
    for (variant, _, case) in wanted!(
        bench,
        rasterize_inria,
        name,
        [0],
        Work::of(pairs, Unit::Pairs)
    ) {
        let choice = Choice {
            variant,
            ..Choice::default()
        };
        let kernel = RasterizeInria::new(&gpu, choice)?;
        let outputs = || {
            let image = floats(&read(&gpu, &input.image)?);
            // Tolerances are those of the engine's own compositing; but what a pixel leaves out weighs as much as the
            // transmittance in front of it, 1e-4 / (1 - 0.99).
            let image = Output::relative("image", image, planes.clone(), 2e-5, 1.0);
            Ok(vec![image.near(near.clone(), 0.01, 0.01)])
        };
        bench.trial(
            &case,
            nothing,
            |rec| kernel.record(rec, bindings(&input), params, input.groups()),
            outputs,
        )?;
    }
    Ok(())
}
