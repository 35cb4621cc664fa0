//! Drawing rules: this engine's, or those of the 3DGS code.

use super::accuracy::Accuracy;
use crate::kernels::{expand, project};

/// Drawing rules: extent of splats, largest alpha, and the end of a pixel's list.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compatibility {
    /// This engine's: a splat reaches as far as its alpha is at least 1/255, alphas end at 1 − 2⁻¹⁶, and the splat that
    /// finishes a pixel counts.
    #[default]
    Engine,
    /// Those of the 3DGS code, for scenes that were trained elsewhere and are to be seen as their authors saw them: a
    /// splat reaches as far as the 16 × 16 tiles that a square of three of its standard deviations touches, alphas end
    /// at 0.99, and the splat that would take the transmittance below 1e-4 is left out. Such frames leak up to 1 %
    /// of what lies behind an opaque wall, and bright splats have edges; [`Accuracy`] does
    /// not apply.
    Inria,
}

impl Compatibility {
    /// Choices of the kernels that list splats.
    pub(super) fn listing(
        self,
        accuracy: &Accuracy,
        project: project::Choice,
        expand: expand::Choice,
    ) -> (project::Choice, expand::Choice) {
        match self {
            Compatibility::Engine => (accuracy.of_project(project), accuracy.of_expand(expand)),
            Compatibility::Inria => {
                let (mut project, mut expand) = (project, expand);
                (project.spec.inria, expand.spec.inria) = (1, 1);
                (project, expand)
            }
        }
    }
}
