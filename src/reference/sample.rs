//! Sampled pixels of a frame with error bounds for a device.
//!
//! Rounding of alphas moves a pixel by at most the sum of their errors, each weighted by the transmittance before it,
//! times the range of the pixel's colours (`dC/dαᵢ = Tᵢ (cᵢ − Bᵢ)`). If a splat lies so near to one of the frame's
//! discontinuities (the alpha threshold, the stop, an exchange in depth, the near plane) that such an error may take it
//! across, its whole share is allowed for. So every pixel of every scene has a bound, as small as that pixel permits.

use super::frame::{center, project_all, sorted};
use super::primitive::power;
use super::rasterize::{layer, raw_alpha};
use super::{Options, Pixel, ScreenSplat, Splat, Thresholds, Viewpoint};
use crate::scene::{Camera, Splats};
use rayon::prelude::*;

/// Half a unit in the last place of 1 in single precision.
const U: f64 = 1.0 / 16_777_216.0;

/// A pixel with its error bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelBound {
    /// Index of the pixel, `y * width + x`.
    pub index: usize,
    /// Colour.
    pub color: [f64; 3],
    /// Transmittance, the background's share.
    pub transmittance: f64,
    /// Maximum error of any channel of the colour.
    pub color_bound: f64,
    /// Maximum error of the transmittance.
    pub transmittance_bound: f64,
}

/// Up to `count` pixels spread over an image, the first and the last among them.
pub fn spread(width: u32, height: u32, count: usize) -> Vec<usize> {
    let pixels = width as usize * height as usize;
    if pixels <= count {
        return (0..pixels).collect();
    }
    // Multiples of the golden ratio are spread evenly over rows as well as over columns.
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let place = |i: usize| ((i as f64 * golden).fract() * pixels as f64) as usize;
    let mut chosen: Vec<usize> = (0..count.saturating_sub(1)).map(place).collect();
    chosen.push(pixels - 1);
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// A projected splat with its errors in single precision.
#[derive(Clone, Copy)]
struct SplatError {
    screen: ScreenSplat<f64>,
    /// Error of its position, px.
    position: f64,
    /// Smallest standard deviation, px.
    sigma_min: f64,
    /// Error of its depth, world units.
    depth: f64,
    /// Error of its colour.
    color: f64,
}

impl SplatError {
    fn new(splat: &Splat<f64>, screen: ScreenSplat<f64>, camera: &Camera) -> SplatError {
        let (focal, middle) = (camera.focal.to_array(), camera.center.to_array());
        let tangent = [0, 1].map(|i| (screen.mean[i] - middle[i]) / focal[i]);
        // Distance from the camera over depth.
        let reach = (1.0 + tangent[0].powi(2) + tangent[1].powi(2)).sqrt();
        let [xx, xy, yy] = screen.covariance;
        let half = 0.5 * (xx - yy);
        let smallest = 0.5 * (xx + yy) - half.hypot(xy);
        let coefficients = (0..3).map(|c| splat.sh.iter().map(|rgb| rgb[c].abs()).sum::<f64>());
        SplatError {
            screen,
            // A view coordinate is a sum of three products with a difference and a rounded matrix: 5U of the distance.
            // A quotient of two is off by 5U · reach · (1 + |tangent|) and its own 5U, which is less than 16U · reach².
            // The principal point is added to its product with the focal length.
            position: 16.0 * U * focal[0].max(focal[1]) * reach * reach
                + 2.0 * U * screen.mean[0].abs().max(screen.mean[1].abs()),
            // The dilation is no smaller than 0.1 px².
            sigma_min: smallest.max(0.1).sqrt(),
            depth: 5.0 * U * screen.depth * reach,
            // Up to sixteen products, each with a polynomial of the direction.
            color: 32.0 * U * (1.0 + coefficients.fold(0.0, f64::max)),
        }
    }

    /// Whether its alpha at a position may be above 0: further out, `raw_alpha` is 0.
    fn reaches(&self, at: [f64; 2]) -> bool {
        let [xx, _, yy] = self.screen.covariance;
        let [dx, dy] = [0, 1].map(|i| at[i] - self.screen.mean[i]);
        dx * dx <= 100.0 * xx && dy * dy <= 100.0 * yy
    }

    /// Error bound of its alpha at a position.
    fn alpha_error(&self, at: [f64; 2], alpha: f64) -> f64 {
        let s = &self.screen;
        let distance = (at[0] - s.mean[0]).hypot(at[1] - s.mean[1]);
        // The position's error, the slope's (8U) over the distance, and that of the whitened residual itself.
        let residual = (2.0 * power(s, at)).max(0.0).sqrt();
        let off = (self.position + 8.0 * U * distance) / self.sigma_min + 64.0 * U * residual;
        // 0.61 is the steepest slope of exp(−x²/2). The exponent's own error: 3e-6 of a logarithm and the
        // specification's 19 units in the last place of exp2 within (−8, 0], twice each, are 256U at most.
        (0.61 * s.opacity * off + 256.0 * U * alpha).min(s.opacity)
    }
}

/// Samples pixels of [`render`](super::render)'s frame.
pub fn sample(splats: &Splats, camera: &Camera, options: &Options, pixels: &[usize]) -> Vec<PixelBound> {
    let view = Viewpoint {
        // Splats just in front of the near plane may be drawn behind it.
        near: options.near * (1.0 - 1e-4),
        ..Viewpoint::new(camera, options, splats.filter)
    };
    let all = Splat::<f64>::all(splats);
    let (list, splat_from_rank) = sorted(&project_all(&all, &view));
    let known: Vec<SplatError> = list
        .iter()
        .zip(&splat_from_rank)
        .map(|(&screen, &i)| SplatError::new(&all[i], screen, camera))
        .collect();
    let of_pixel = |&index: &usize| {
        let mut walk = RayBound::new(options);
        let at = center(index, camera.width as usize);
        for splat in known.iter().filter(|splat| splat.reaches(at)) {
            if walk.is_over {
                break;
            }
            walk.meet(splat, at);
        }
        walk.finish(index, options.background)
    };
    pixels.par_iter().map(of_pixel).collect()
}

/// Error bound of a ray, accumulated front to back.
struct RayBound<'a> {
    options: &'a Options,
    pixel: Pixel<f64>,
    /// Minimum and maximum of each channel so far.
    range: [[f64; 3]; 2],
    /// Errors of alphas, as a share of the range.
    share: f64,
    /// Change by colour errors.
    color: f64,
    /// Relative error of the transmittance.
    transmittance: f64,
    layers: usize,
    /// Last splats of uncertain order among each other.
    group: DepthTie,
    /// Whether the ray may have stopped: later splats only widen the range of colours.
    may_be_over: bool,
    is_over: bool,
}

impl RayBound<'_> {
    fn new(options: &Options) -> RayBound<'_> {
        RayBound {
            options,
            pixel: Pixel::clear(),
            range: [options.background; 2],
            share: 0.0,
            color: 0.0,
            transmittance: 0.0,
            layers: 0,
            group: DepthTie::EMPTY,
            may_be_over: false,
            is_over: false,
        }
    }

    /// Passes a splat.
    fn meet(&mut self, splat: &SplatError, at: [f64; 2]) {
        let thresholds: &Thresholds = &self.options.thresholds;
        let before = self.pixel.transmittance;
        let (least, most) = (1.0 - self.transmittance, 1.0 + self.transmittance);
        if before * most < thresholds.transmittance_min {
            // Certainly stopped; with splats of uncertain order possibly sooner.
            if self.group.count > 1 {
                self.share += thresholds.transmittance_min;
            }
            self.is_over = true;
            return;
        }
        let alpha = raw_alpha(&splat.screen, at);
        let error = splat.alpha_error(at, alpha);
        if alpha + error < thresholds.alpha_min {
            return;
        }
        widen(&mut self.range, splat.screen.color);
        if self.may_be_over {
            return;
        }
        if before * least < thresholds.transmittance_min {
            // Uncertain stop: splats behind contribute at most the light that arrives here.
            self.share += before;
            self.may_be_over = true;
            return;
        }
        let is_doubtful = (alpha - thresholds.alpha_min).abs() <= error
            || (splat.screen.depth - self.options.near).abs() <= splat.depth;
        self.share += before * if is_doubtful { alpha + error } else { error };
        self.exchange(splat, alpha, before);
        let is_seen = splat.screen.depth >= self.options.near;
        if let Some(layer) = layer(&splat.screen, at, thresholds).filter(|_| is_seen) {
            self.color += before * layer.alpha * splat.color;
            self.pixel = self.pixel.over(&layer);
            self.layers += 1;
        }
        let passed = 1.0 - alpha.min(thresholds.alpha_max);
        let lost = if is_doubtful { alpha + error } else { error };
        self.transmittance += (lost / passed).min(1.0);
    }

    /// Allows for either order of splats at practically one depth.
    fn exchange(&mut self, splat: &SplatError, alpha: f64, before: f64) {
        if splat.screen.depth - splat.depth > self.group.farthest {
            self.color += self.group.cost();
            self.group = DepthTie {
                light: before,
                ..DepthTie::EMPTY
            };
        }
        self.group.join(splat, alpha);
    }

    fn finish(mut self, index: usize, background: [f64; 3]) -> PixelBound {
        self.color += self.group.cost();
        let pixel = self.pixel.over_background(background);
        let [low, high] = self.range;
        let range = (0..3).map(|c| high[c] - low[c]).fold(0.0, f64::max);
        let brightest = high.into_iter().fold(0.0, f64::max);
        // Each layer rounds the sum, the transmittance and their product.
        let sums = 3.0 * (self.layers + 2) as f64 * U;
        PixelBound {
            index,
            color: pixel.color,
            transmittance: pixel.transmittance,
            color_bound: self.share * range + self.color + sums * brightest,
            transmittance_bound: self.share + sums,
        }
    }
}

/// Includes a colour in the minimum and maximum of each channel.
fn widen(range: &mut [[f64; 3]; 2], color: [f64; 3]) {
    for (channel, value) in color.into_iter().enumerate() {
        range[0][channel] = range[0][channel].min(value);
        range[1][channel] = range[1][channel].max(value);
    }
}

/// Splats of uncertain order.
#[derive(Clone, Copy)]
struct DepthTie {
    count: usize,
    /// Upper bound of the depth of the farthest.
    farthest: f64,
    /// Light that reaches the first.
    light: f64,
    alphas: f64,
    /// Σ αᵢ αⱼ over all pairs.
    pairs: f64,
    /// Transmittance of all together.
    passes: f64,
    range: [[f64; 3]; 2],
}

impl DepthTie {
    const EMPTY: DepthTie = DepthTie {
        count: 0,
        farthest: f64::NEG_INFINITY,
        light: 1.0,
        alphas: 0.0,
        pairs: 0.0,
        passes: 1.0,
        range: [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]],
    };

    fn join(&mut self, splat: &SplatError, alpha: f64) {
        self.count += 1;
        self.farthest = self.farthest.max(splat.screen.depth + splat.depth);
        self.pairs += self.alphas * alpha;
        self.alphas += alpha;
        self.passes *= 1.0 - alpha;
        widen(&mut self.range, splat.screen.color);
    }

    /// Maximum change by another order. An exchange of two changes a pixel by αᵢ αⱼ T (cᵢ − cⱼ), and the light through
    /// both not at all; every order gives a mixture of their colours.
    fn cost(&self) -> f64 {
        if self.count < 2 {
            return 0.0;
        }
        let [low, high] = self.range;
        let range = (0..3).map(|c| high[c] - low[c]).fold(0.0, f64::max);
        self.light * self.pairs.min(1.0 - self.passes) * range
    }
}
