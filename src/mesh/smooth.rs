//! Smoothing of a map's depths within surfaces.

use super::depth_map::DepthMap;
use rayon::prelude::*;

/// Distance of a pair's mean from the pixel's own depth at which the pair has a quarter of its weight, footprints of a
/// pixel: larger details stay.
const DETAIL: f32 = 0.5;
/// Standard deviations at which the Gaussian ends.
const CUTOFF: f64 = 2.0;

/// Two pixels opposite each other around a third.
struct Pair {
    right: isize,
    down: isize,
    /// Of both, where the pixel between them has 1.
    weight: f32,
}

impl DepthMap {
    /// Smooths inverse depths by a Gaussian of a standard deviation of a few pixels; 0 leaves them. Depths of splats
    /// are noisy from pixel to pixel, and a mesh of them has rough normals.
    ///
    /// Each is averaged with pairs of pixels opposite each other around it. Inverse depths are affine over the picture
    /// of a plane, and so the mean of a pair is exact there, at any angle and up to the border. Pairs count less the
    /// farther their mean is from the pixel's own depth, by the square of a Cauchy weight: borders, edges and details
    /// beyond half a footprint stay. Pixels without a surface stay so.
    pub fn smooth(&mut self, deviation: f64) {
        let pairs = pairs(deviation);
        if pairs.is_empty() {
            return;
        }
        let (width, height) = (self.camera.width as isize, self.camera.height as isize);
        let inverse: Vec<f32> = self.depth.iter().map(|depth| depth.recip()).collect();
        let focal = self.camera.focal.max_element() as f32;
        let smooth = |(pixel, depth): (usize, &mut f32)| {
            let own = inverse[pixel];
            let (x, y) = (pixel as isize % width, pixel as isize / width);
            let (mut sum, mut weights) = (own, 1.0);
            for pair in &pairs {
                let has_both = pair.right.abs() <= x.min(width - 1 - x) && pair.down <= y.min(height - 1 - y);
                if !has_both {
                    continue;
                }
                let offset = pair.down * width + pair.right;
                let there = |offset: isize| inverse[pixel.wrapping_add_signed(offset)];
                let mean = 0.5 * (there(offset) + there(-offset));
                let apart = (mean / own - 1.0) * focal / DETAIL;
                let weight = pair.weight / (1.0 + apart * apart).powi(2);
                // Written so that NaN does not count.
                if weight > 0.0 {
                    sum += weight * mean;
                    weights += weight;
                }
            }
            *depth = weights / sum;
        };
        self.depth.par_iter_mut().enumerate().for_each(smooth);
    }
}

/// Pairs of a Gaussian.
fn pairs(deviation: f64) -> Vec<Pair> {
    let radius = (CUTOFF * deviation).floor() as isize;
    let offsets = (0..=radius).flat_map(|down| (-radius..=radius).map(move |right| (right, down)));
    let half = offsets.filter(|&(right, down)| down > 0 || right > 0);
    let pair = |(right, down): (isize, isize)| {
        let distance = ((right * right + down * down) as f64).sqrt() / deviation;
        (distance <= CUTOFF).then(|| Pair {
            right,
            down,
            weight: 2.0 * (-0.5 * distance * distance).exp() as f32,
        })
    };
    half.filter_map(pair).collect()
}
