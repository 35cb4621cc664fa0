//! How far a frame that saves work may lie from the one that does not: a bound for every pixel, and for the
//! gradient of every parameter.
//!
//! With `C = Σ cᵢ αᵢ Tᵢ + T_end · background` and `Bᵢ` what is seen through splat `i`, a splat that is left
//! out changes the pixel by `αᵢ Tᵢ (Bᵢ − cᵢ)`. Taken out from the back, each splat of a set leaves the
//! transmittance before the others alone, so that a set `S` costs at most `Σ_S αᵢ Tᵢ` times the range of the
//! pixel's colours, with the weights of the whole frame. The other approximations follow from it:
//!
//! * An alpha cut, a limit on standard deviations and removed splats leave out what they say.
//! * A stop at the transmittance `t`, the last splat included, replaces what is behind by the background,
//!   where less than `t` passes: `t` times the range, and nothing where more passes through everything.
//! * Colours that are off by `δᵢ` cost `Σ αᵢ Tᵢ δᵢ`. Of harmonics of degree `l` that are off by the
//!   vector `d_l`, `δ ≤ Σ_l ‖d_l‖ √((2l+1) / 4π)` in every direction (Cauchy–Schwarz, and the addition
//!   theorem, by which `Σ_m Y_lm² = (2l+1) / 4π`).
//! * Alphas that are `αᵢ'` instead cost `Σ |αᵢ' − αᵢ| Tᵢ` times the range: exchanged one after the other from the
//!   back, each finds the transmittance before it as it was. Splats left out then count with
//!   `αᵢ' Tᵢ'`.
//!
//! Gradients follow from the same: see [`gradient_bounds`].

mod gradient;
mod picture;
mod stack;

pub use gradient::{GradientBounds, Rounding, gradient_bounds};
pub use picture::{Traced, color_errors, trace};

use crate::scene::Splats;

/// What a frame saves.
#[derive(Clone, Debug, PartialEq)]
pub struct Approximations {
    /// Alphas below this are left out.
    pub alpha_min: f64,
    /// A pixel is finished once less than this passes.
    pub transmittance_min: f64,
    /// By how much any channel of a splat's colour may be off, by splat; empty: nothing.
    pub color_error: Vec<f64>,
    /// Which splats are not drawn; empty: none.
    pub removed: Vec<bool>,
    /// The scene whose shapes and opacities are drawn in place of its own, splat by splat and with the same means,
    /// not noticeably larger: beyond ten of their own standard deviations splats are taken for nothing. Its colours
    /// do not count: [`Approximations::color_error`] does.
    pub stored: Option<Splats>,
}

/// How far, relatively, a threshold may be moved by rounding: what lies that near to one counts as left out.
const MARGIN: f64 = 1e-3;

/// Depths that differ by less than this, relatively, may come in either order: a depth in `f32` is a sum of
/// three rounded products, and a few units in the last place of the largest are ten of the result's.
const SAME_DEPTH: f64 = 2e-6;

/// Alphas below this do not widen a pixel's range of colours; all of them are left out instead, at the range
/// that they have.
const FAINT: f64 = 1e-9;

impl Approximations {
    /// None at all.
    pub const NONE: Approximations = Approximations {
        alpha_min: 0.0,
        transmittance_min: 0.0,
        color_error: Vec::new(),
        removed: Vec::new(),
        stored: None,
    };

    /// Whether a splat may be left out of a pixel where it has this alpha, the transmittance threshold aside.
    fn may_leave_out(&self, splat: usize, alpha: f64) -> bool {
        alpha < self.alpha_min * (1.0 + MARGIN) || self.removed.get(splat).copied().unwrap_or(false)
    }
}
