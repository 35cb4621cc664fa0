//! Gradient by the splats on the screen from the gradient by an image.
//!
//! The chain is cut after every layer of a pixel, and between a layer and its splat. Each piece (the pixel after a
//! layer by the pixel before it and the layer; the layer by the splat's screen row) is differentiated by duals; the
//! pieces are multiplied from the back.

use super::expand::Isect;
use super::frame::{center, sorted};
use super::rasterize::{Layer, Pixel, blended, layer};
use super::tiles::Grid;
use super::{Dual, Options, Real, ScreenSplat, Thresholds};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Derivatives of the objective by one pixel of the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelGradient {
    /// By the colour.
    pub color: [f64; 3],
    /// By the remaining transmittance.
    pub transmittance: f64,
    /// By the depth sum.
    pub depth: f64,
}

/// Gradient of one splat on the screen, with statistics over the pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScreenGradient {
    /// Derivatives by [`ScreenSplat::row`]: mean xy, covariance xx xy yy, opacity, rgb, depth. The covariance's xy
    /// counts once, standing for both off-diagonal entries.
    pub row: [f64; 10],
    /// Sums over the pixels of the magnitude of each one's derivative by mean x and y (AbsGS).
    pub mean_abs: [f64; 2],
    /// `Σ α T` over the pixels.
    pub weight_sum: f64,
    /// Largest `α T` of any pixel.
    pub weight_max: f64,
    /// Pixels that blend the splat.
    pub pixels: u32,
}

impl ScreenGradient {
    /// Derivatives by the mean, per pixel of the image.
    pub fn mean(&self) -> [f64; 2] {
        [self.row[0], self.row[1]]
    }

    fn absorb(&mut self, other: &ScreenGradient) {
        for (sum, term) in self.row.iter_mut().zip(other.row) {
            *sum += term;
        }
        for (sum, term) in self.mean_abs.iter_mut().zip(other.mean_abs) {
            *sum += term;
        }
        self.weight_sum += other.weight_sum;
        self.weight_max = self.weight_max.max(other.weight_max);
        self.pixels += other.pixels;
    }
}

/// Gradient of one pixel by each splat that it blends, nearest first: `(index into splats, gradient)`.
pub fn pixel_backward(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    background: [f64; 3],
    thresholds: &Thresholds,
    upstream: &PixelGradient,
) -> Vec<(usize, ScreenGradient)> {
    let by_layers = layer_slopes(splats, order, position, background, thresholds, upstream);
    let gradient = |LayerSlopes { index, slopes, weight }: LayerSlopes| {
        let row = screen_slopes(&splats[index], position, thresholds, slopes);
        let gradient = ScreenGradient {
            row,
            mean_abs: [row[0].abs(), row[1].abs()],
            weight_sum: weight,
            weight_max: weight,
            pixels: 1,
        };
        (index, gradient)
    };
    by_layers.into_iter().map(gradient).collect()
}

/// Derivatives of the objective by a layer of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerSlopes {
    /// Index of its splat.
    pub index: usize,
    /// By alpha, rgb and depth.
    pub slopes: [f64; 5],
    /// `α T`.
    pub weight: f64,
}

/// Derivatives by each layer that a pixel blends, nearest first.
pub fn layer_slopes(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    background: [f64; 3],
    thresholds: &Thresholds,
    upstream: &PixelGradient,
) -> Vec<LayerSlopes> {
    let list = blended(splats, order, position, thresholds);
    let layers: Vec<Layer<f64>> = list
        .iter()
        .filter_map(|&i| layer(&splats[i], position, thresholds))
        .collect();
    let mut before = vec![Pixel::clear()];
    for (rank, layer) in layers.iter().enumerate() {
        before.push(before[rank].over(layer));
    }
    // By the pixel after the last layer: through the background, and directly.
    let mut by_pixel = background_slopes(&before[layers.len()], background, upstream);
    let mut found = Vec::with_capacity(list.len());
    for (rank, &index) in list.iter().enumerate().rev() {
        let (by_before, slopes) = blend_slopes(&before[rank], &layers[rank], by_pixel);
        by_pixel = by_before;
        let weight = layers[rank].alpha * before[rank].transmittance;
        found.push(LayerSlopes { index, slopes, weight });
    }
    found.reverse();
    found
}

/// Numbers as variables `first..` of a dual.
fn variables<const COUNT: usize, const N: usize>(values: [f64; COUNT], first: usize) -> [Dual<N>; COUNT] {
    let mut slot = first;
    values.map(|value| {
        slot += 1;
        Dual::variable(value, Some(slot - 1))
    })
}

/// A pixel in one row: rgb, transmittance, depth.
fn pixel_row<R: Real>(pixel: &Pixel<R>) -> [R; 5] {
    let [r, g, b] = pixel.color;
    [r, g, b, pixel.transmittance, pixel.depth]
}

fn pixel_from_row<R: Real>([r, g, b, transmittance, depth]: [R; 5]) -> Pixel<R> {
    Pixel {
        color: [r, g, b],
        transmittance,
        depth,
    }
}

/// Derivatives of `Σ slope · number`.
fn weighted<const N: usize>(numbers: &[Dual<N>], slopes: &[f64]) -> [f64; N] {
    let terms = numbers.iter().zip(slopes);
    terms
        .map(|(number, slope)| *number * Dual::of(*slope))
        .sum::<Dual<N>>()
        .d
}

/// Derivatives of the objective by the pixel's row before the background is added.
fn background_slopes(pixel: &Pixel<f64>, background: [f64; 3], upstream: &PixelGradient) -> [f64; 5] {
    let lifted: Pixel<Dual<5>> = pixel_from_row(variables(pixel_row(pixel), 0));
    let [r, g, b] = upstream.color;
    let slopes = [r, g, b, upstream.transmittance, upstream.depth];
    weighted(&pixel_row(&lifted.over_background(background)), &slopes)
}

/// Derivatives by the pixel's row before a layer, and by the layer's alpha, rgb and depth, given those by the
/// pixel's row after it.
fn blend_slopes(before: &Pixel<f64>, layer: &Layer<f64>, by_after: [f64; 5]) -> ([f64; 5], [f64; 5]) {
    let lifted: Pixel<Dual<10>> = pixel_from_row(variables(pixel_row(before), 0));
    let [r, g, b] = layer.color;
    let [alpha, r, g, b, depth] = variables([layer.alpha, r, g, b, layer.depth], 5);
    let layer = Layer {
        alpha,
        color: [r, g, b],
        depth,
    };
    let d = weighted(&pixel_row(&lifted.over(&layer)), &by_after);
    let [r, g, b, transmittance, depth, by_layer @ ..] = d;
    ([r, g, b, transmittance, depth], by_layer)
}

/// Derivatives by the splat's row, given those by its layer at the pixel.
fn screen_slopes(
    splat: &ScreenSplat<f64>,
    position: [f64; 2],
    thresholds: &Thresholds,
    by_layer: [f64; 5],
) -> [f64; 10] {
    assert!(splat.disc.is_none(), "a surfel's gradient is not one by its row");
    let lifted: ScreenSplat<Dual<10>> = ScreenSplat::from_row(variables(splat.row(), 0));
    let Some(layer) = layer(&lifted, position, thresholds) else {
        return [0.0; 10];
    };
    let [r, g, b] = layer.color;
    weighted(&[layer.alpha, r, g, b, layer.depth], &by_layer)
}

/// Gradients of all pixels of a frame by every splat, indexed like `screen`.
pub fn rasterize_backward(
    screen: &[Option<ScreenSplat<f64>>],
    width: u32,
    options: &Options,
    upstream: &[PixelGradient],
) -> Vec<ScreenGradient> {
    let (list, splat_from_rank) = sorted(screen);
    let order: Vec<usize> = (0..list.len()).collect();
    let width = width as usize;
    let nothing = || vec![ScreenGradient::default(); list.len()];
    // Rows are added in order, so that sums do not depend on the distribution of rows to threads.
    let rows: Vec<Vec<ScreenGradient>> = upstream
        .par_chunks(width)
        .enumerate()
        .map(|(y, row)| {
            let mut sums = nothing();
            for (x, upstream) in row.iter().enumerate() {
                let position = center(y * width + x, width);
                let (background, thresholds) = (options.background, &options.thresholds);
                let said = pixel_backward(&list, &order, position, background, thresholds, upstream);
                for (rank, gradient) in said {
                    sums[rank].absorb(&gradient);
                }
            }
            sums
        })
        .collect();
    let mut gradients = vec![ScreenGradient::default(); screen.len()];
    for sums in rows {
        for (rank, sum) in sums.iter().enumerate() {
            gradients[splat_from_rank[rank]].absorb(sum);
        }
    }
    gradients
}

/// Gradients by intersection: one for every (splat, tile) pair that some pixel blends. The sum over a splat's tiles
/// equals [`rasterize_backward`].
pub fn isect_backward(
    screen: &[Option<ScreenSplat<f64>>],
    grid: &Grid,
    background: [f64; 3],
    thresholds: &Thresholds,
    upstream: &[PixelGradient],
) -> BTreeMap<Isect, ScreenGradient> {
    let (list, splat_from_rank) = sorted(screen);
    let order: Vec<usize> = (0..list.len()).collect();
    let mut gradients: BTreeMap<Isect, ScreenGradient> = BTreeMap::new();
    for (index, upstream) in upstream.iter().enumerate() {
        let position = center(index, grid.width as usize);
        let tile = grid.tile_from_position(position);
        for (rank, gradient) in pixel_backward(&list, &order, position, background, thresholds, upstream) {
            let splat = splat_from_rank[rank] as u32;
            gradients.entry(Isect { tile, splat }).or_default().absorb(&gradient);
        }
    }
    gradients
}
