//! Drawing rules of this engine and of the 3DGS code.

use super::accuracy::Accuracy;
use crate::kernels::{expand, project};

/// Drawing rules: extent of splats, largest alpha, and the end of a pixel's list.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compatibility {
    /// This engine's: a splat extends to alpha 1/255, alphas are at most 1 − 2⁻¹⁶, and the splat that finishes a pixel
    /// counts.
    #[default]
    Engine,
    /// Those of the 3DGS code, for faithful pictures of scenes trained elsewhere: a splat extends over the 16 × 16
    /// tiles that a square of three of its standard deviations touches, alphas are at most 0.99, and the splat that
    /// would bring the transmittance below 1e-4 is omitted. Opaque walls then leak up to 1 % of the light behind them,
    /// and bright splats have edges. [`Accuracy`] does not apply.
    Inria,
}

impl Compatibility {
    /// Choices of the kernels that list splats.
    pub(super) fn listing(
        self,
        accuracy: &Accuracy,
        mut project: project::Choice,
        mut expand: expand::Choice,
    ) -> (project::Choice, expand::Choice) {
        match self {
            Compatibility::Engine => {
                project.spec.log2_alpha_min = accuracy.log2_alpha_min();
                expand.spec.log2_alpha_min = accuracy.log2_alpha_min();
            }
            Compatibility::Inria => (project.spec.inria, expand.spec.inria) = (1, 1),
        }
        (project, expand)
    }
}
