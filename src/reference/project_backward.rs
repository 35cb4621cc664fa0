//! From the gradient of a splat on the screen to the gradient of its raw parameters, by duals.

use super::project::GEOMETRY_PARAMETERS;
use super::{Dual, Splat, Viewpoint, project};

/// Variables per pass: the geometry fits in one.
const LANES: usize = GEOMETRY_PARAMETERS;

/// Derivatives of the objective by [`Splat::parameters`], given those by
/// [`ScreenSplat::row`](super::ScreenSplat::row). Zero throughout for a splat that is not drawn.
pub fn project_backward(splat: &Splat<f64>, view: &Viewpoint, by_screen: &[f64; 10]) -> Vec<f64> {
    let values = splat.parameters();
    let mut gradient = Vec::with_capacity(values.len());
    for first in (0..values.len()).step_by(LANES) {
        let lifted: Vec<Dual<LANES>> = values
            .iter()
            .enumerate()
            .map(|(i, &value)| Dual::variable(value, i.checked_sub(first)))
            .collect();
        let mut slopes = [0.0; LANES];
        if let Some(screen) = project(&Splat::from_parameters(&lifted), view) {
            for (number, slope) in screen.row().iter().zip(by_screen) {
                for (sum, d) in slopes.iter_mut().zip(number.d) {
                    *sum += slope * d;
                }
            }
        }
        let lanes = LANES.min(values.len() - first);
        gradient.extend(&slopes[..lanes]);
    }
    gradient
}
