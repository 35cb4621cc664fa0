//! Inputs of a training step.

use super::colors::ColorStep;
use super::config::TrainConfig;
use super::transients::PatchGrid;
use crate::layout::View;
use crate::render::{DepthBands, Forward, RowBand};

/// Inputs of a step.
pub(crate) struct Step<'a> {
    pub(crate) config: &'a TrainConfig,
    pub(crate) forward: &'a Forward,
    pub(crate) iteration: u32,
    /// Scene extent in world units.
    pub(crate) extent: f64,
    /// View of the drawn rows.
    pub(crate) view: &'a View,
    /// The drawn rows, and which of them count.
    pub(crate) rows: RowBand,
    /// Width and height of the photograph.
    pub(crate) size: [u32; 2],
    /// Of the drawn rows among the parts of the photograph: `PART_*`.
    pub(crate) part: u32,
    pub(crate) sh_degree: u32,
    pub(crate) color: ColorStep,
    pub(crate) bands: DepthBands,
    /// Gains of the photograph, and slopes on the curve's toe.
    pub(crate) exposure: [[f32; 3]; 2],
    /// Offset of the lattice of SSIM's windows, pixels.
    pub(crate) window_offset: [u32; 2],
    /// Patches of the photograph, if the run leaves some out.
    pub(crate) patches: Option<PatchGrid>,
    /// Weights of the terms of geometry.
    pub(crate) geometry: [f32; 2],
}

/// Exposure of photographs without one.
pub(crate) const UNEXPOSED: [[f32; 3]; 2] = [[1.0; 3]; 2];
