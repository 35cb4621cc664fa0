//! Case of `rasterize_inria`: compositing by the rules of the 3DGS code, over the engine's own lists.

use super::KernelCase;
use super::composite::{Composite, CompositeBuffers};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::rasterize_inria::{self, Params, RasterizeInria};
use crate::kernels::walker_bindings;
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats};
use crate::reference;
use crate::render::tile_stride;
use rayon::prelude::*;

/// An image of a composite's splats.
pub fn rasterize_inria<'a>(gpu: &Gpu, composite: &'a Composite) -> Result<KernelCase<'a, RasterizeInria>> {
    // Pixel, number of splats blended, and relative distance to the nearest threshold.
    let pixel = |i: usize| {
        let (tile, at) = composite.place(i);
        let ranks = &composite.ranks_from_tile[tile];
        let listed = ranks.iter().map(|&rank| &composite.splats[rank]);
        reference::rasterize_inria::over(listed, at, composite.background())
    };
    let pixels: Vec<_> = (0..composite.pixels.len()).into_par_iter().map(pixel).collect();
    let plane = |i: usize| {
        pixels.iter().map(move |(shown, ..)| match i {
            3 => shown.transmittance,
            _ => shown.color[i],
        })
    };
    let planes: Vec<f64> = (0..4).flat_map(plane).collect();
    let near: Vec<bool> = pixels.iter().map(|&(.., nearest)| nearest <= 1e-4).collect();
    let near = near.repeat(4);
    let pairs = pixels.iter().map(|&(_, blended, _)| blended).sum();
    let input = CompositeBuffers::new(gpu, composite)?;
    let case = KernelCase::new(Work::of(pairs, "blended pairs")).compare(&input.image, move |found| {
        // Tolerances are those of the engine's own compositing; but what a pixel leaves out weighs as much as the
        // transmittance in front of it, 1e-4 / (1 - 0.99).
        let image = Output::relative("image", floats(&found), planes.clone(), 2e-5, 1.0);
        vec![image.near(near.clone(), 0.01, 0.01)]
    });
    Ok(case.commands(move |rec, kernel: &RasterizeInria, _| {
        let io = walker_bindings! {
            rasterize_inria, input, &input.emitted_from_isect;
            blue_depth_from_splat: &input.blue_depth_from_splat,
            image: &input.image,
            depth: &input.depth,
            isect_end_from_pixel: &input.isect_end_from_pixel,
        };
        let params = Params {
            tile_stride: tile_stride(input.tiles),
        };
        kernel.record(rec, io, params, input.groups());
    }))
}
