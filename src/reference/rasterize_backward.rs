//! From the gradient of an image to the gradient of the splats on the screen.
//!
//! The chain is cut where a pixel sees a splat: the pixel's objective by one layer's alpha, colour and depth
//! (the other layers constant), and that alpha by the splat's numbers on the screen. Both pieces are duals.

use super::frame::{center, sorted};
use super::rasterize::{Layer, Pixel, blended, composite, layer};
use super::{Cuts, Dual, Real, ScreenSplat};
use rayon::prelude::*;

/// Derivatives of the objective by one pixel of the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelGradient {
    /// By the colour.
    pub color: [f64; 3],
    /// By the transmittance that is left.
    pub transmittance: f64,
    /// By the depth sum.
    pub depth: f64,
}

impl PixelGradient {
    fn dot<R: Real>(&self, pixel: &Pixel<R>) -> R {
        let color: R = (0..3).map(|c| R::of(self.color[c]) * pixel.color[c]).sum();
        color + R::of(self.transmittance) * pixel.transmittance + R::of(self.depth) * pixel.depth
    }
}

/// What the pixels say about one splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScreenGradient {
    /// Derivatives by [`ScreenSplat::row`]: mean xy, covariance xx xy yy, opacity, rgb, depth. The
    /// covariance's xy counts once, standing for both off-diagonal entries.
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

/// What one pixel says about each splat that it blends, nearest first: `(index into splats, gradient)`.
pub fn pixel_backward(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    background: [f64; 3],
    cuts: &Cuts,
    upstream: &PixelGradient,
) -> Vec<(usize, ScreenGradient)> {
    let list = blended(splats, order, position, cuts);
    let layers: Vec<Layer<f64>> = list
        .iter()
        .filter_map(|&i| layer(&splats[i], position, cuts))
        .collect();
    let mut transmittance = 1.0;
    let mut gradients = Vec::new();
    for (rank, &index) in list.iter().enumerate() {
        let by_layer = layer_slopes(&layers, rank, background, cuts, upstream);
        let weight = layers[rank].alpha * transmittance;
        transmittance *= 1.0 - layers[rank].alpha;
        let row = screen_slopes(&splats[index], position, cuts, by_layer);
        let gradient = ScreenGradient {
            row,
            mean_abs: [row[0].abs(), row[1].abs()],
            weight_sum: weight,
            weight_max: weight,
            pixels: 1,
        };
        gradients.push((index, gradient));
    }
    gradients
}

/// Derivatives of the pixel's objective by alpha, colour and depth of layer `rank`.
fn layer_slopes(
    layers: &[Layer<f64>],
    rank: usize,
    background: [f64; 3],
    cuts: &Cuts,
    upstream: &PixelGradient,
) -> [f64; 5] {
    let lifted = layers.iter().enumerate().map(|(i, layer)| {
        let number = |value, slot| Dual::<5>::variable(value, (i == rank).then_some(slot));
        let [r, g, b] = layer.color;
        Layer {
            alpha: number(layer.alpha, 0),
            color: [number(r, 1), number(g, 2), number(b, 3)],
            depth: number(layer.depth, 4),
        }
    });
    upstream
        .dot(&composite(lifted, background, cuts.transmittance_min).0)
        .d
}

/// Derivatives by the splat's row, given those by its layer at the pixel.
fn screen_slopes(
    splat: &ScreenSplat<f64>,
    position: [f64; 2],
    cuts: &Cuts,
    by_layer: [f64; 5],
) -> [f64; 10] {
    let mut slot = 0;
    let lifted = ScreenSplat::from_row(splat.row().map(|value| {
        slot += 1;
        Dual::<10>::variable(value, Some(slot - 1))
    }));
    let Some(layer) = layer(&lifted, position, cuts) else {
        return [0.0; 10];
    };
    let [r, g, b] = layer.color;
    let numbers = [layer.alpha, r, g, b, layer.depth];
    let total: Dual<10> = numbers
        .iter()
        .zip(by_layer)
        .map(|(n, slope)| *n * Dual::of(slope))
        .sum();
    total.d
}

/// What all pixels of a frame say about every splat; the result is indexed like `screen`.
pub fn rasterize_backward(
    screen: &[Option<ScreenSplat<f64>>],
    width: u32,
    background: [f64; 3],
    cuts: &Cuts,
    upstream: &[PixelGradient],
) -> Vec<ScreenGradient> {
    let (list, splat_from_rank) = sorted(screen);
    let order: Vec<usize> = (0..list.len()).collect();
    let width = width as usize;
    let nothing = || vec![ScreenGradient::default(); list.len()];
    // Rows are added up in order, so that the sums do not depend on how the rows were shared out.
    let rows: Vec<Vec<ScreenGradient>> = upstream
        .par_chunks(width)
        .enumerate()
        .map(|(y, row)| {
            let mut sums = nothing();
            for (x, upstream) in row.iter().enumerate() {
                let position = center(y * width + x, width);
                let said = pixel_backward(&list, &order, position, background, cuts, upstream);
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
