//! Gradient by a splat's raw parameters from that by its screen row, by duals.

use super::project::GEOMETRY_PARAMETERS;
use super::{Dual, Real, Splat, Terms, Viewpoint, project};

/// Variables per pass: the geometry fits in one.
pub(super) const LANES: usize = GEOMETRY_PARAMETERS;

/// Derivatives of the objective by [`Splat::parameters`], given those by
/// [`ScreenSplat::row`](super::ScreenSplat::row). Zero throughout for a splat that is not drawn.
pub fn project_backward(splat: &Splat<f64>, view: &Viewpoint, by_screen: &[f64; 10]) -> Vec<f64> {
    differentiate(splat, |lifted| match project(lifted, view) {
        Some(screen) => {
            let terms = screen.row().into_iter().zip(by_screen);
            terms.map(|(number, &slope)| number * Dual::of(slope)).sum()
        }
        None => Dual::of(0.0),
    })
}

/// Derivatives of [`ScreenSplat::row`](super::ScreenSplat::row) by each of [`Splat::parameters`]; zero throughout for
/// a splat that is not drawn.
pub fn slopes(splat: &Splat<f64>, view: &Viewpoint) -> Vec<[f64; 10]> {
    let mut slopes = Vec::new();
    for (lifted, lanes) in lifted(splat, Dual::<LANES>::variable) {
        let row = project(&lifted, view).map_or([Dual::of(0.0); 10], |screen| screen.row());
        slopes.extend((0..lanes).map(|lane| row.map(|number| number.d[lane])));
    }
    slopes
}

/// Error bound of computed [`slopes`], in unit roundoffs, including their products with gradients by the row and the
/// sum of these: see [`Terms`].
pub fn slope_terms(splat: &Splat<f64>, view: &Viewpoint) -> Vec<[f64; 10]> {
    let mut terms = Vec::new();
    for (lifted, lanes) in lifted(splat, Terms::<LANES>::variable) {
        let row = project(&lifted, view).map_or([Terms::of(0.0); 10], |screen| screen.row());
        // One product and one sum per number of the row.
        let off = row.map(|number| number.off(10.0));
        terms.extend((0..lanes).map(|lane| off.map(|off| off[lane])));
    }
    terms
}

/// Weights of one splat's penalties in the loss, whether the splat is visible or not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PenaltyWeights {
    /// Weight of the opacity (3DGS-MCMC, section 3.4).
    pub opacity: f64,
    /// Weight of Σ scale (there as well).
    pub scale: f64,
    /// Weight of ½ Σ scale².
    pub size: f64,
}

/// Sum of the [`PenaltyWeights`] of one splat.
pub fn penalty<R: Real>(splat: &Splat<R>, weights: PenaltyWeights) -> R {
    let scales: R = splat.log_scale.iter().map(|s| s.exp()).sum();
    let squares: R = splat.log_scale.iter().map(|s| s.exp().squared()).sum();
    R::of(weights.opacity) * splat.opacity_logit.sigmoid()
        + R::of(weights.scale) * scales
        + R::of(0.5 * weights.size) * squares
}

/// Derivatives of [`penalty`] by [`Splat::parameters`].
pub fn penalty_backward(splat: &Splat<f64>, weights: PenaltyWeights) -> Vec<f64> {
    differentiate(splat, |lifted| penalty(lifted, weights))
}

/// Derivatives of a function by all parameters of a splat, a few per pass.
pub(super) fn differentiate(splat: &Splat<f64>, function: impl Fn(&Splat<Dual<LANES>>) -> Dual<LANES>) -> Vec<f64> {
    let passes = lifted(splat, Dual::variable).into_iter();
    passes
        .flat_map(|(lifted, lanes)| function(&lifted).d.into_iter().take(lanes))
        .collect()
}

/// Copies of a splat, each with a few parameters as variables, and their number; `variable` makes a variable or a
/// constant.
pub(super) fn lifted<R: Real>(
    splat: &Splat<f64>,
    variable: impl Fn(f64, Option<usize>) -> R,
) -> Vec<(Splat<R>, usize)> {
    let values = splat.parameters();
    let pass = |first: usize| {
        let lifted: Vec<R> = values
            .iter()
            .enumerate()
            .map(|(i, &value)| variable(value, i.checked_sub(first)))
            .collect();
        (Splat::from_parameters(&lifted), LANES.min(values.len() - first))
    };
    (0..values.len()).step_by(LANES).map(pass).collect()
}
