//! Effect of a splat on pixels: its weight, and their change by its removal.

use super::rasterize::{rasterize, weights};
use super::{ScreenSplat, Thresholds};

/// Effect of a splat on some pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RemovalError {
    /// Sum of its weights.
    pub weight: f64,
    /// Sum, over pixels and channels, of the squared change by its removal.
    pub change: f64,
    /// Error of `change` per δ, if every colour and every weight has error δ, for small δ. The colour behind a splat is
    /// a sum divided by the transmittance behind it: errors grow with that.
    pub slack: f64,
}

/// Effect of one splat on a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Touch {
    /// Index into the splats.
    pub splat: usize,
    /// Its weight `αᵢ Tᵢ`.
    pub weight: f64,
    /// Change of each channel by removal: `w (B − c)`, B the colour seen through it.
    pub change: [f64; 3],
    /// Ratio of its weight to the transmittance behind it, 0 if the pixel ends there.
    pub ratio: f64,
}

impl RemovalError {
    /// Adds a pixel.
    pub fn and(self, touch: &Touch) -> RemovalError {
        let square: f64 = touch.change.iter().map(|c| c * c).sum();
        let reach = 1.0 + touch.ratio;
        let slack: f64 = touch.change.iter().map(|c| 2.0 * c.abs() * reach).sum();
        RemovalError {
            weight: self.weight + touch.weight,
            change: self.change + square,
            // The square of an error of 1e-5 counts where nothing changes.
            slack: self.slack + slack + 3.0 * 1e-5 * reach * reach,
        }
    }
}

/// Effects of all splats that a pixel blends, nearest first. Behind the end of the ray lies the background.
pub fn touches(
    splats: &[ScreenSplat<f64>],
    order: &[usize],
    position: [f64; 2],
    background: [f64; 3],
    thresholds: &Thresholds,
) -> Vec<Touch> {
    let blended = weights(splats, order, position, thresholds);
    // From the farthest: no cancellation.
    let mut passing = rasterize(splats, order, position, background, thresholds).transmittance;
    let mut seen = background.map(|c| c * passing);
    let touch = |&(splat, weight): &(usize, f64)| {
        let color = splats[splat].color;
        let behind = |k: usize| match passing > 0.0 {
            true => seen[k] / passing,
            false => background[k],
        };
        let touch = Touch {
            splat,
            weight,
            change: [0, 1, 2].map(|k| weight * (behind(k) - color[k])),
            ratio: match passing >= thresholds.transmittance_min {
                true => weight / passing,
                false => 0.0,
            },
        };
        passing += weight;
        (0..3).for_each(|k| seen[k] += weight * color[k]);
        touch
    };
    let mut touches: Vec<Touch> = blended.iter().rev().map(touch).collect();
    touches.reverse();
    touches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_splat_changes_what_a_picture_without_it_lacks() {
        let splat = |opacity: f64, shade: f64| ScreenSplat {
            mean: [0.0; 2],
            covariance: [1.0, 0.0, 1.0],
            opacity,
            color: [shade, 1.0 - shade, 0.5],
            depth: 1.0,
            disc: None,
        };
        let splats = [splat(0.5, 0.9), splat(0.3, 0.1), splat(0.7, 0.6)];
        let background = [0.2, 0.4, 0.8];
        let color = |order: &[usize]| rasterize(&splats, order, [0.0; 2], background, &Thresholds::ENGINE).color;
        let whole = color(&[0, 1, 2]);
        let found = touches(&splats, &[0, 1, 2], [0.0; 2], background, &Thresholds::ENGINE);
        assert_eq!(found.len(), 3);
        for (touch, rest) in found.iter().zip([[1, 2], [0, 2], [0, 1]]) {
            let without = color(&rest);
            for k in 0..3 {
                assert!((touch.change[k] - (without[k] - whole[k])).abs() < 1e-12);
            }
        }
    }
}
