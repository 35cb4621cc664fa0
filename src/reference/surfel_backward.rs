//! Gradient by the parameters of surfels from the gradient by an image. A surfel has no row of numbers on the screen:
//! the layer of each pixel is differentiated by all parameters at once, from its projection on, by duals.

use super::frame::{center, project_all, sorted};
use super::project_backward::{LANES, lifted};
use super::rasterize::layer;
use super::rasterize_backward::{PixelGradient, layer_slopes};
use super::{Dual, Options, Real, ScreenSplat, Splat, Viewpoint, project};
use rayon::prelude::*;

/// A projected splat with derivatives by some of its parameters, and their number.
type LiftedScreen = (ScreenSplat<Dual<LANES>>, usize);

/// Derivatives of the objective by [`Splat::parameters`] of each splat.
pub fn surfel_backward(
    splats: &[Splat<f64>],
    view: &Viewpoint,
    options: &Options,
    upstream: &[PixelGradient],
) -> Vec<Vec<f64>> {
    let (list, splat_from_rank) = sorted(&project_all(splats, view));
    let order: Vec<usize> = (0..list.len()).collect();
    let screens = |&splat: &usize| -> Vec<LiftedScreen> {
        let passes = lifted(&splats[splat], Dual::variable).into_iter();
        passes
            .filter_map(|(lifted, lanes)| Some((project(&lifted, view)?, lanes)))
            .collect()
    };
    let lifted: Vec<Vec<LiftedScreen>> = splat_from_rank.par_iter().map(screens).collect();
    let width = view.camera.width as usize;
    // Pixels are added in order, so that sums do not depend on their distribution to threads.
    let of_rows: Vec<Vec<Vec<f64>>> = upstream
        .par_chunks(width)
        .enumerate()
        .map(|(y, row)| {
            let mut sums: Vec<Vec<f64>> = lifted.iter().map(|passes| vec![0.0; parameters(passes)]).collect();
            for (x, upstream) in row.iter().enumerate() {
                let at = center(y * width + x, width);
                let (background, thresholds) = (options.background, &options.thresholds);
                for found in layer_slopes(&list, &order, at, background, thresholds, upstream) {
                    add(&mut sums[found.index], &lifted[found.index], at, options, found.slopes);
                }
            }
            sums
        })
        .collect();
    let mut rows: Vec<Vec<f64>> = splats.iter().map(|splat| vec![0.0; splat.parameters().len()]).collect();
    for sums in of_rows {
        for (rank, sum) in sums.iter().enumerate() {
            let row = &mut rows[splat_from_rank[rank]];
            row.iter_mut().zip(sum).for_each(|(row, term)| *row += term);
        }
    }
    rows
}

fn parameters(passes: &[LiftedScreen]) -> usize {
    passes.iter().map(|(_, lanes)| lanes).sum()
}

/// Adds the derivatives at a pixel, given those by the layer's alpha, rgb and depth.
fn add(sums: &mut [f64], passes: &[LiftedScreen], position: [f64; 2], options: &Options, slopes: [f64; 5]) {
    let mut first = 0;
    for (screen, lanes) in passes {
        if let Some(layer) = layer(screen, position, &options.thresholds) {
            let [r, g, b] = layer.color;
            let numbers = [layer.alpha, r, g, b, layer.depth].into_iter().zip(slopes);
            let total: Dual<LANES> = numbers.map(|(number, slope)| number * Dual::of(slope)).sum();
            let of_pass = sums[first..first + lanes].iter_mut().zip(total.d);
            of_pass.for_each(|(sum, d)| *sum += d);
        }
        first += lanes;
    }
}
