//! Kernels of a step from the gradient of the frame to that of the splats, with terms of geometry or without.

use super::config::TrainConfig;
use super::device::DeviceState;
use super::gradients::Gradients;
use super::schedule;
use super::step::Step;
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups, Recorder};
use crate::kernels::project_backward::ProjectBackward;
use crate::kernels::rasterize::Outputs;
use crate::kernels::{project_backward, rasterize_backward, surface_loss};
use crate::layout::PART_END;
use crate::render::{Block, Forward, Model, ModelKernels, Scratch, tile_stride};

/// Gradients of compositing and of projection, for frames with some outputs.
#[derive(Debug)]
pub(crate) struct ChainKernels {
    outputs: Outputs,
    rasterize: rasterize_backward::RasterizeBackward,
    project: ModelKernels<ProjectBackward>,
}

/// Kernels of steps with terms of geometry, in place of those without.
#[derive(Debug)]
pub(crate) struct GeometryPass {
    pub(super) forward: Forward,
    loss: surface_loss::SurfaceLoss,
    pub(super) chain: ChainKernels,
}

impl GeometryPass {
    /// Compiles the kernels; `None` for a run without terms of geometry.
    pub(super) fn new(gpu: &Gpu, config: &TrainConfig) -> Result<Option<GeometryPass>> {
        let outputs = config.outputs();
        if !outputs.surface {
            return Ok(None);
        }
        let mut loss = surface_loss::Choice::default();
        loss.spec.with_spread = outputs.spread.into();
        Ok(Some(GeometryPass {
            forward: Forward::for_training(gpu, config.sh_degree, &config.accuracy, outputs)?,
            loss: surface_loss::SurfaceLoss::new(gpu, loss)?,
            chain: ChainKernels::new(gpu, config, outputs)?,
        }))
    }

    /// Compiles further kernels that steps of `model` with SH up to `sh_degree` need.
    pub(super) fn prepare(&mut self, gpu: &Gpu, model: &Model, sh_degree: u32) -> Result<()> {
        self.forward.prepare(gpu, model, sh_degree)?;
        self.chain.prepare(gpu, model, sh_degree)
    }

    /// Gradient of the terms by the frame's surface.
    pub(super) fn record(&self, rec: &mut Recorder<'_>, s: &Scratch, g: &Gradients, step: &Step<'_>) {
        let pixels = step.size[0] as usize * step.size[1] as usize;
        let [normal, spread] = step.geometry.map(|weight| (f64::from(weight) / pixels as f64) as f32);
        self.loss.record(
            rec,
            surface_loss::Bindings {
                view: &s.view,
                image: &s.image,
                surface: &s.surface,
                d_image: &g.d_image,
            },
            surface_loss::Params {
                normal_scale: normal,
                spread_scale: spread,
                counted: step.rows.counted,
            },
            surface_loss::groups(step.view.size),
        );
        rec.timestamp("surface_loss");
    }
}

impl ChainKernels {
    /// Compiles the kernels for frames with these outputs.
    pub(super) fn new(gpu: &Gpu, config: &TrainConfig, outputs: Outputs) -> Result<ChainKernels> {
        let mut rasterize = rasterize_backward::Choice::prefer(gpu.caps(), outputs);
        rasterize.spec.log2_alpha_min = config.accuracy.log2_alpha_min();
        Ok(ChainKernels {
            outputs,
            rasterize: rasterize_backward::RasterizeBackward::new(gpu, rasterize)?,
            project: ModelKernels::new(),
        })
    }

    /// Compiles further kernels that steps of `model` with SH up to `sh_degree` need. Required before the first of
    /// them.
    pub(super) fn prepare(&mut self, gpu: &Gpu, model: &Model, sh_degree: u32) -> Result<()> {
        let (is_indexed, outputs) = (model.is_indexed(), self.outputs);
        self.project.prepare(gpu, (model, false), sh_degree, |degree| {
            ProjectBackward::of_degree(gpu, degree, is_indexed, outputs)
        })
    }

    /// Gradients of every (splat, tile) pair of a band, with the ends of its pixels' lists.
    pub(super) fn record_rasterize(
        &self,
        rec: &mut Recorder<'_>,
        s: &Scratch,
        g: &Gradients,
        step: &Step<'_>,
        (band, ends): (u32, &Buffer<u32>),
    ) {
        let tiles = (step.view.tiles[0] * step.view.tiles[1]) as usize;
        self.rasterize.record(
            rec,
            rasterize_backward::Bindings {
                view: &s.view,
                range_from_tile: &s.range_from_tile,
                emitted_from_isect: &s.emitted_from_isect[Forward::sorted_index(tiles)],
                splat_from_emitted: &s.splat_from_emitted,
                ellipse_from_splat: &s.ellipse_from_splat,
                whiten_rg_from_splat: &s.whiten_rg_from_splat,
                blue_depth_from_splat: &s.blue_depth_from_splat,
                image: &s.image,
                d_image: &g.d_image,
                isect_end_from_pixel: ends,
                d_shape_from_source: &g.records.d_shape_from_source,
                d_tone_from_source: &g.records.d_tone_from_source,
                d_rest_from_source: &g.records.d_rest_from_source,
                plane_from_splat: &s.plane_from_splat,
            },
            rasterize_backward::Params {
                tile_stride: tile_stride(tiles),
                band,
            },
            Groups::Count(tiles as u32),
        );
        rec.timestamp("rasterize_backward");
    }

    /// Gradients of a block's splats, or of a part of a photograph in parts the sums of their records.
    pub(super) fn record_project(
        &self,
        rec: &mut Recorder<'_>,
        state: &DeviceState,
        s: &Scratch,
        g: &Gradients,
        step: &Step<'_>,
        block: Block,
    ) {
        let penalties = schedule::penalties(step.config, step.extent);
        let count = state.model.splat_count;
        let at = state.model.places(&block);
        let splats = at.splats;
        let kernel = self.project.of(&state.model, false, step.sh_degree.min(block.degree));
        kernel.record(
            rec,
            project_backward::Bindings {
                view: &s.view,
                counts: &s.counts,
                params: &state.model.params[block.index],
                tile_count_from_splat: &s.tile_count_from_splat.part(splats.clone()),
                emitted_from_splat: &s.emitted_from_splat.part(splats.clone()),
                ellipse_from_splat: &s.ellipse_from_splat.part(splats.clone()),
                whiten_rg_from_splat: &s.whiten_rg_from_splat.part(splats.clone()),
                blue_depth_from_splat: &s.blue_depth_from_splat.part(splats.clone()),
                d_shape_from_source: &g.records.d_shape_from_source,
                d_tone_from_source: &g.records.d_tone_from_source,
                d_rest_from_source: &g.records.d_rest_from_source,
                d_params: state.gradients(block),
                statistics: &state.buffers.statistics.part(splats),
                splat_from_slot: &at.splat_from_slot,
            },
            project_backward::Params {
                splat_count: block.count as u32,
                stride: block.stride as u32,
                // Means over all splats, and over axes.
                opacity_penalty: penalties.opacity / count as f32,
                scale_penalty: penalties.scale / (state.model.primitive.scale_count() * count) as f32,
                // Slope of a sum of squares: twice the weight.
                size_penalty: 2.0 * penalties.size,
                banded: u32::from(s.replay.is_some() && step.part != PART_END),
                part: step.part,
            },
            kernel.groups(block.count),
        );
        rec.timestamp("project_backward");
    }
}
