//! Bounds of the distance of an approximated frame from the exact one: for every pixel, and for the gradient of every
//! parameter.
//!
//! With `C = Σ cᵢ αᵢ Tᵢ + T_end · background` and `Bᵢ` the colour seen through splat `i`, leaving out a splat changes
//! the pixel by `αᵢ Tᵢ (Bᵢ − cᵢ)`. Taken out from the back, each splat of a set leaves the transmittance before the
//! others unchanged, so that a set `S` costs at most `Σ_S αᵢ Tᵢ` times the range of the pixel's colours, with the
//! weights of the exact frame. The other approximations follow from it:
//!
//! * An alpha threshold and removed splats leave out the splats concerned.
//! * A stop at the transmittance `t`, the last splat included, replaces everything behind by the background: `t` times
//!   the range if the remaining transmittance is below `t`, and nothing otherwise.
//! * Colour errors `δᵢ` cost `Σ αᵢ Tᵢ δᵢ`. For SH coefficients of degree `l` with the error vector `d_l`,
//!   `δ ≤ Σ_l   ‖d_l‖ √((2l+1) / 4π)` in every direction (Cauchy–Schwarz, and the addition theorem,
//!   `Σ_m Y_lm² = (2l+1) / 4π`).
//! * Alphas `αᵢ'` instead of `αᵢ` cost `Σ |αᵢ' − αᵢ| Tᵢ` times the range: replaced one after the other from the back,
//!   each has the unchanged transmittance before it. Splats left out then count with `αᵢ' Tᵢ'`.
//!
//! Bounds of gradients follow likewise: see [`gradient_bounds`].

mod gradient;
mod picture;
mod stack;

pub use gradient::{GradientBounds, Rounding, gradient_bounds};
pub use picture::{TracedPixel, color_errors, trace};

use crate::scene::Splats;

/// Approximations of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Approximations {
    /// Alphas below this are skipped.
    pub alpha_min: f64,
    /// A pixel is finished once its transmittance is below this.
    pub transmittance_min: f64,
    /// Maximum error of any channel, by splat; empty: none.
    pub color_error: Vec<f64>,
    /// By splat: whether it is not drawn; empty: none.
    pub removed: Vec<bool>,
    /// Scene drawn instead, splat by splat and with the same means, by its shapes and opacities. It must not be
    /// noticeably larger: splats beyond ten of their own standard deviations count as absent. Its colours are ignored
    /// in favour of [`Approximations::color_error`].
    pub stored: Option<Splats>,
}

/// Relative tolerance of thresholds for rounding: values this near count as left out.
const MARGIN: f64 = 1e-3;

/// Relative difference of depths below which either order is possible: a depth in `f32` is a sum of three rounded
/// products, and a few units in the last place of the largest are ten of the result's.
const SAME_DEPTH: f64 = 2e-6;

/// Alphas below this do not widen a pixel's range of colours; they are all left out instead, at their own range.
const FAINT: f64 = 1e-9;

impl Approximations {
    /// No approximations.
    pub const NONE: Approximations = Approximations {
        alpha_min: 0.0,
        transmittance_min: 0.0,
        color_error: Vec::new(),
        removed: Vec::new(),
        stored: None,
    };

    /// Whether a splat of this alpha may be left out of a pixel, apart from the transmittance threshold.
    fn may_leave_out(&self, splat: usize, alpha: f64) -> bool {
        alpha < self.alpha_min * (1.0 + MARGIN) || self.removed.get(splat).copied().unwrap_or(false)
    }
}
