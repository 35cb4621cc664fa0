//! How far pictures have moved, held pixel by pixel against what was promised.

use super::contribution::{ContributionPass, RenderedTiles};
use crate::Result;
use crate::layout::{TILE_HEIGHT, TILE_WIDTH};
use crate::render::Compatibility;
use crate::scene::Camera;

/// What was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    /// Pixels looked at.
    pub pixels: usize,
    /// The largest change of any channel of any pixel, where 1 is white.
    pub most: f64,
    /// What may change there at most.
    pub bound_there: f64,
    /// The largest range of colours of any tile.
    pub range: f64,
    /// The largest change relative to its bound.
    pub nearest: f64,
    /// Channels of pixels that changed by more than their bound.
    pub broken: usize,
}

/// What a pixel may have let through when it ended: the splat that ended it counted where the engine draws
/// ([`crate::render::Accuracy`]); by the rules of the 3DGS code it did not, and covered 0.99 at most.
fn leak_limit(compatibility: Compatibility) -> f64 {
    match compatibility {
        Compatibility::Engine => 1e-4,
        Compatibility::Inria => 1e-4 / (1.0 - 0.99) * (1.0 + 1e-5),
    }
}

/// What was promised of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Promise {
    /// What the weights of all that it lacks sum to at most, at any pixel.
    pub weight: f64,
    /// By how much a channel of a splat's colour is off at most.
    pub color: f64,
}

/// Draws all views by both and compares them, where `after` is what was promised. `None` where `go_on` says no.
///
/// # Errors
/// As [`ContributionPass::losses`].
pub fn measure(
    before: &mut ContributionPass,
    after: &mut ContributionPass,
    cameras: &[Camera],
    promise: Promise,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Option<Change>> {
    let mut change = Change::default();
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

impl Change {
    fn add(
        &mut self,
        camera: &Camera,
        before: &RenderedTiles,
        after: &RenderedTiles,
        (promise, leak): (Promise, f64),
    ) {
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
        // A number that is none is no change to be content with.
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

/// By how much two pictures of a pixel with so many splats may differ from those of exact arithmetic. The n-th weight
/// is a product of 2 n rounded factors, its term one more, and n terms are summed: 3 n + 1 roundings of 2⁻²⁴ of what is
/// a mixture of colours, the background's share included, in each picture.
fn rounding(splats: u32, low: f64, high: f64) -> f64 {
    let roundings = 2.0 * (3.0 * f64::from(splats) + 4.0);
    roundings * 2f64.powi(-24) * high.abs().max(low.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_beyond_its_bound_is_counted() {
        let mut change = Change::default();
        change.take(0.5, 1.0, 1.0);
        assert_eq!((change.broken, change.nearest), (0, 0.5));
        change.take(2.0, 1.0, 1.0);
        assert_eq!(
            (change.broken, change.most, change.bound_there),
            (1, 2.0, 1.0)
        );
        change.take(f64::NAN, 1.0, 1.0);
        assert_eq!(change.broken, 2);
        change.take(0.0, 0.0, 0.0);
        assert_eq!(change.broken, 2);
    }
}
