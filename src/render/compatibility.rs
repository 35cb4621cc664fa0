//! Whose rules a frame is drawn by.

use super::accuracy::Accuracy;
use super::options::RenderOptions;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::rasterize::Outputs;
use crate::kernels::{expand, project, rasterize, rasterize_inria};

/// Whose rules a frame is drawn by: where splats end, and where pixels do.
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
    /// What the kernels that list splats are compiled with.
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

/// The kernel that composites, by whose rules.
#[derive(Debug)]
pub(super) enum Compositor {
    /// See [`Compatibility::Engine`].
    Engine(rasterize::Rasterize),
    /// See [`Compatibility::Inria`].
    Inria(rasterize_inria::RasterizeInria),
}

impl Compositor {
    /// Compiles it.
    pub(super) fn new(gpu: &Gpu, options: &RenderOptions, outputs: Outputs) -> Result<Compositor> {
        let caps = gpu.caps();
        Ok(match options.compatibility {
            Compatibility::Engine => {
                let choice = rasterize::Choice::prefer(caps).of_outputs(outputs);
                let choice = options.accuracy.of_rasterize(choice);
                Compositor::Engine(rasterize::Rasterize::new(gpu, choice)?)
            }
            Compatibility::Inria => {
                let choice = rasterize_inria::Choice::of_outputs(outputs);
                Compositor::Inria(rasterize_inria::RasterizeInria::new(gpu, choice)?)
            }
        })
    }
}
