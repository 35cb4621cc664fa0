//! Measured difference between the pictures of two scenes, without a bound.

use crate::Result;
use crate::scene::Camera;
use crate::simplify::ContributionPass;

/// Difference over all pixels of all views.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Difference {
    /// Pixels compared.
    pub pixels: usize,
    /// Largest difference of any channel of any pixel; 1 is white.
    pub most: f64,
    /// Root mean square difference.
    pub rms: f64,
}

impl Difference {
    /// PSNR of one against the other, decibels; infinite if equal.
    pub fn psnr_db(&self) -> f64 {
        -20.0 * self.rms.log10()
    }
}

/// Renders and compares all views. `None` if `go_on`, called before every view, returns false.
///
/// # Errors
/// As [`ContributionPass::losses`].
pub fn difference(
    before: &mut ContributionPass,
    after: &mut ContributionPass,
    cameras: &[Camera],
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Option<Difference>> {
    let (mut found, mut squares) = (Difference::default(), 0.0);
    for camera in cameras {
        if !go_on() {
            return Ok(None);
        }
        let [before, after] = [before.show(camera)?, after.show(camera)?];
        let pixels = camera.width as usize * camera.height as usize;
        found.pixels += pixels;
        let channels = before.planes.iter().zip(&after.planes).take(3 * pixels);
        for (a, b) in channels {
            let moved = (f64::from(*a) - f64::from(*b)).abs();
            // NaN counts as infinitely far off.
            let moved = if moved.is_nan() { f64::INFINITY } else { moved };
            found.most = found.most.max(moved);
            squares += moved * moved;
        }
    }
    found.rms = (squares / (3 * found.pixels.max(1)) as f64).sqrt();
    Ok(Some(found))
}
