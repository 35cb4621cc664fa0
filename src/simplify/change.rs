//! Measured change between two renderings, compared with its proven bound at every pixel.

use super::contribution::{ContributionPass, RenderedTiles};
use crate::Result;
use crate::layout::{TILE_HEIGHT, TILE_WIDTH};
use crate::render::Compatibility;
use crate::scene::Camera;

/// Change over all pixels of all views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeasuredChange {
    /// Pixels compared.
    pub pixels: usize,
    /// Largest change of any channel of any pixel; 1 is white.
    pub most: f64,
    /// Bound at the pixel and channel of the largest change.
    pub bound_there: f64,
    /// Largest range of colours in any tile.
    pub range: f64,
    /// Largest ratio of a change to its bound.
    pub nearest: f64,
    /// Number of (pixel, channel) pairs beyond their bound.
    pub broken: usize,
}

/// Upper bound of the transmittance at which a pixel's ray ends. By the engine's rules the splat that ends it still
/// counts ([`crate::render::Accuracy`]); by those of the 3DGS code it does not, with alpha 0.99 at most.
fn leak_limit(compatibility: Compatibility) -> f64 {
    match compatibility {
        Compatibility::Engine => 1e-4,
        Compatibility::Inria => 1e-4 / (1.0 - 0.99) * (1.0 + 1e-5),
    }
}

/// Bounds that a reduced scene was made to satisfy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Promise {
    /// Maximum, over pixels, of the summed weights of the removed splats.
    pub weight: f64,
    /// Maximum error of any channel of a splat's colour.
    pub color: f64,
}

/// Renders all views of both scenes and compares them; `promise` is the bound of `after`. `None` if `go_on` returns
/// false.
///
/// # Errors
/// As [`ContributionPass::losses`].
pub fn measure(
    before: &mut ContributionPass,
    after: &mut ContributionPass,
    cameras: &[Camera],
    promise: Promise,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Option<MeasuredChange>> {
    let mut change = MeasuredChange::default();
    let leak = leak_limit(before.pass_options().compatibility);
    for camera in cameras {
        if !go_on() {
            return Ok(None);
        }
        let shown = before.show(camera)?;
        change.add(camera, &shown, &after.show(camera)?, (promise, leak));
    }
    Ok(Some(change))
}

impl MeasuredChange {
    fn add(&mut self, camera: &Camera, before: &RenderedTiles, after: &RenderedTiles, (promise, leak): (Promise, f64)) {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let pixels = width * height;
        let columns = width.div_ceil(TILE_WIDTH as usize);
        self.pixels += pixels;
        for pixel in 0..pixels {
            let (x, y) = (pixel % width, pixel / width);
            let tile = y / TILE_HEIGHT as usize * columns + x / TILE_WIDTH as usize;
            let passing = f64::from(before.planes[3 * pixels + pixel]);
            let lost = promise.weight + if passing < leak { passing } else { 0.0 };
            let splats = before.count_from_tile[tile];
            for (channel, range) in before.range_from_tile[tile].iter().enumerate() {
                let at = channel * pixels + pixel;
                let [low, high] = range.map(f64::from);
                let range = high - low + 2.0 * promise.color;
                let bound = lost * range + promise.color + rounding(splats, low, high);
                let moved = (f64::from(before.planes[at]) - f64::from(after.planes[at])).abs();
                self.take(moved, bound, high - low);
            }
        }
    }

    fn take(&mut self, moved: f64, bound: f64, range: f64) {
        self.range = self.range.max(range);
        // NaN counts as beyond the bound.
        if moved.is_nan() || moved > bound {
            self.broken += 1;
        }
        if moved > self.most {
            (self.most, self.bound_there) = (moved, bound);
        }
        if bound > 0.0 {
            self.nearest = self.nearest.max(moved / bound);
        }
    }
}

/// Rounding error of two renderings of a pixel with so many splats. The n-th weight is a product of 2 n rounded
/// factors, its term one more, and n terms are summed: 3 n + 1 roundings of 2⁻²⁴, relative to a mixture of colours and
/// the background, in each picture.
fn rounding(splats: u32, low: f64, high: f64) -> f64 {
    let roundings = 2.0 * (3.0 * f64::from(splats) + 4.0);
    roundings * 2f64.powi(-24) * high.abs().max(low.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_beyond_its_bound_is_counted() {
        let mut change = MeasuredChange::default();
        change.take(0.5, 1.0, 1.0);
        assert_eq!((change.broken, change.nearest), (0, 0.5));
        change.take(2.0, 1.0, 1.0);
        assert_eq!((change.broken, change.most, change.bound_there), (1, 2.0, 1.0));
        change.take(f64::NAN, 1.0, 1.0);
        assert_eq!(change.broken, 2);
        change.take(0.0, 0.0, 0.0);
        assert_eq!(change.broken, 2);
    }
}
