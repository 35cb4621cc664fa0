//! The compositing kernel of a renderer.

use super::compatibility::Compatibility;
use super::options::RenderOptions;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::rasterize::Outputs;
use crate::kernels::{rasterize, rasterize_inria};

/// The compositing kernel of a set of drawing rules.
#[derive(Debug)]
pub(super) enum Compositor {
    /// See [`Compatibility::Engine`].
    Engine(rasterize::Rasterize),
    /// See [`Compatibility::Inria`].
    Inria(rasterize_inria::RasterizeInria),
}

impl Compositor {
    /// Compiles the kernel for the options' drawing rules.
    pub(super) fn new(gpu: &Gpu, options: &RenderOptions, outputs: Outputs) -> Result<Compositor> {
        let caps = gpu.caps();
        Ok(match options.compatibility {
            Compatibility::Engine => {
                let mut choice = rasterize::Choice::prefer(caps, outputs);
                choice.spec.log2_alpha_min = options.accuracy.log2_alpha_min();
                choice.spec.t_min = options.accuracy.transmittance_min;
                Compositor::Engine(rasterize::Rasterize::new(gpu, choice)?)
            }
            Compatibility::Inria => {
                let choice = rasterize_inria::Choice::default().of_outputs(outputs);
                Compositor::Inria(rasterize_inria::RasterizeInria::new(gpu, choice)?)
            }
        })
    }
}
