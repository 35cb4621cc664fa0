//! The oracle: what every kernel ought to compute, written for obviousness, in `f64`.
//!
//! One file per operation, under the operation's name. Nothing here is a transliteration of a shader:
//! covariances are full matrices, every pixel looks at every splat, spherical harmonics come from the
//! Legendre recurrence, SSIM is a plain double sum, tiles are found by looking at their pixels. What the
//! formulas are written over is the trait [`Real`]: `f64` gives values, [`Dual`] gives exact derivatives
//! without any step size, `f32` shows what plain single precision would do.
//!
//! A frame is discontinuous where an alpha crosses 1/255, where a ray is declared finished, where two
//! splats change order. The oracle says of every pixel how far it is from each of these ([`DiscontinuityMargin`]), so
//! that comparisons keep their tight tolerance and excuse only the pixels that have the right to flip.
//!
//! **Invariant:** works without a Vulkan driver existing; imports `scene` and `layout` only.
//!
#![doc = include_str!("../../docs/numerics.md")]

pub mod adam;
pub mod bound;
pub mod contribution;
pub mod expand;
pub mod frame;
pub mod gradient;
pub mod linear;
pub mod loss;
pub mod perturb;
pub mod project;
pub mod project_backward;
pub mod prune_limit;
pub mod ranges;
pub mod rasterize;
pub mod rasterize_backward;
pub mod rasterize_inria;
pub mod ray;
pub mod relocate;
pub mod removal_error;
pub mod sample;
pub mod scan;
pub mod selftest;
pub mod sh;
pub mod smoothing;
pub mod sort;
pub mod ssim;
pub mod tiles;

mod dual;
mod real;
mod running_error;

pub use dual::Dual;
pub use frame::{Frame, render};
pub use gradient::{LossGradient, loss_gradient};
pub use project::{ScreenSplat, Splat, Viewpoint, project};
pub use rasterize::{DiscontinuityMargin, Pixel};
pub use real::Real;
pub use running_error::Terms;

use crate::layout;

/// Where compositing thresholds corners, each cut at a threshold of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// A splat whose alpha at a pixel is below this is skipped there.
    pub alpha_min: f64,
    /// An alpha is capped at this, with zero gradient beyond.
    pub alpha_max: f64,
    /// A splat is blended only where the transmittance before it is at least this.
    pub transmittance_min: f64,
}

impl Thresholds {
    /// What the engine does: 1/255 (3DGS paper, appendix C), `ALPHA_MAX`, 1e-4.
    pub const ENGINE: Thresholds = Thresholds {
        alpha_min: 1.0 / 255.0,
        alpha_max: layout::ALPHA_MAX as f64,
        transmittance_min: 1e-4,
    };

    /// Nothing skipped, nothing stopped; only the cap remains, which belongs to the model.
    pub const NONE: Thresholds = Thresholds {
        alpha_min: 0.0,
        transmittance_min: 0.0,
        ..Thresholds::ENGINE
    };
}

/// How a frame is to be drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Colour behind everything, rgb.
    pub background: [f64; 3],
    /// Splats whose centre is nearer than this along the view's z are not drawn; world units.
    pub near: f64,
    /// Highest spherical-harmonic degree that takes part.
    pub sh_degree: u32,
    /// Which thresholds compositing makes.
    pub thresholds: Thresholds,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            background: [0.0; 3],
            near: 0.01,
            sh_degree: 3,
            thresholds: Thresholds::ENGINE,
        }
    }
}
