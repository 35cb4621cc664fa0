//! Reference of every kernel in `f64`, written for obviousness.
//!
//! One file per operation, named after it. Nothing here is a transliteration of a shader: covariances are full
//! matrices, every pixel tests every splat, spherical harmonics come from the Legendre recurrence, SSIM is a plain
//! double sum, tiles are found from their pixels. Formulas are generic over [`Real`]: `f64` gives values, [`Dual`]
//! gives exact derivatives without a step size, `f32` shows plain single precision.
//!
//! A frame is discontinuous where an alpha crosses 1/255, a ray is finished, or two splats change order. The distance
//! of every pixel from each of these ([`DiscontinuityMargin`]) keeps tolerances tight and excuses only the pixels that
//! may flip.
//!
//! **Invariant:** works without a Vulkan driver; imports `scene` and `layout` only.
//!
#![doc = include_str!("../../docs/numerics.md")]

pub mod adam;
pub mod bound;
pub mod contribution;
pub mod delinearize;
pub mod dropout;
pub mod expand;
pub mod frame;
pub mod gradient;
pub mod linear;
pub mod linearize;
pub mod loss;
pub mod overlay;
pub mod perturb;
pub mod plane;
pub mod primitive;
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
pub mod surface_loss;
pub mod surfel;
pub mod surfel_backward;
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

/// Thresholds of compositing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// Splats of lower alpha at a pixel are skipped there.
    pub alpha_min: f64,
    /// Cap of alphas, with zero gradient beyond.
    pub alpha_max: f64,
    /// A splat is blended only if the transmittance before it is at least this.
    pub transmittance_min: f64,
}

impl Thresholds {
    /// Thresholds of the engine: 1/255 (3DGS paper, appendix C), `ALPHA_MAX`, 1e-4.
    pub const ENGINE: Thresholds = Thresholds {
        alpha_min: 1.0 / 255.0,
        alpha_max: layout::ALPHA_MAX as f64,
        transmittance_min: 1e-4,
    };

    /// No skipping and no stop; only the cap remains, which belongs to the model.
    pub const NONE: Thresholds = Thresholds {
        alpha_min: 0.0,
        transmittance_min: 0.0,
        ..Thresholds::ENGINE
    };
}

/// Options of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Background colour, rgb.
    pub background: [f64; 3],
    /// Near plane along the view's z, world units; splats with nearer means are not drawn.
    pub near: f64,
    /// Highest SH degree used.
    pub sh_degree: u32,
    /// Thresholds of compositing.
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
