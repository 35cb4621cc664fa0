//! Case of `removal_error`: the change of a tile's pixels without each of its splats.

use super::KernelCase;
use super::composite::{Composite, CompositeBuffers};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::removal_error::{self, Choice, Params, RemovalError as Kernel};
use crate::kernels::walker_bindings;
use crate::lab::bench::check::Output;
use crate::reference::Thresholds;
use crate::reference::removal_error::{RemovalError, Touch, touches};
use crate::render::tile_stride;

/// The composited image.
pub fn removal_error<'a>(gpu: &Gpu, composite: &'a Composite) -> Result<KernelCase<'a, Kernel>> {
    let background = composite.background();
    let mut expected = vec![RemovalError::default(); composite.lists.isects.len()];
    composite.fold_sources(
        |_, ranks, at| {
            let touches = touches(&composite.splats, ranks, at, background, &Thresholds::ENGINE);
            touches.into_iter().map(|touch| (touch.splat, touch)).collect()
        },
        |source, _, touch: &Touch| expected[source] = expected[source].and(touch),
    );
    let planes: Vec<f32> = composite.planes().iter().map(|&c| c as f32).collect();
    let input = CompositeBuffers::new(gpu, composite)?;
    let image = gpu.buffer_from("image", &planes)?;
    let records = gpu.buffer::<[f32; 3]>("record_from_emitted", expected.len())?;
    let outputs = composite.kernel_outputs();
    let case = KernelCase::new(composite.work()).tune(move |choice: &mut Choice| *choice = choice.of_outputs(outputs));
    let case = case.compare(&records, move |found| {
        let column = |i: usize| found.iter().map(|r| f64::from(r[i])).collect::<Vec<_>>();
        let wanted = |of: fn(&RemovalError) -> f64| expected.iter().map(of).collect::<Vec<_>>();
        // Weights err as in `contribution`, and colours as in `rasterize`: 2e-5 of what there is. What that makes of
        // the changes is their slack, which they are judged in units of.
        let (tolerance, jump) = (2e-5, 128.0 * 2.0 / 255.0);
        let units = |changes: Vec<f64>| -> Vec<f64> {
            let of = |(change, wanted): (f64, &RemovalError)| change / wanted.slack.max(1e-30);
            changes.into_iter().zip(&expected).map(of).collect()
        };
        let near = || composite.near_sources();
        let weight = Output::relative("weight", column(0), wanted(|i| i.weight), tolerance, 128.0);
        let (changes, expected) = (units(column(1)), units(wanted(|i| i.change)));
        let change = Output::relative("change", changes, expected, tolerance, 1.0);
        vec![
            weight.near(near(), jump, 0.02),
            change.near(near(), f64::INFINITY, 0.02),
        ]
    });
    Ok(case.commands(move |rec, kernel: &Kernel, _| {
        let io = walker_bindings! {
            removal_error, input, &input.emitted_from_isect;
            blue_depth_from_splat: &input.blue_depth_from_splat,
            image: &image,
            record_from_emitted: &records,
            plane_from_splat: &input.plane_from_splat,
        };
        let params = Params {
            tile_stride: tile_stride(input.tiles),
        };
        kernel.record(rec, io, params, input.groups());
    }))
}
