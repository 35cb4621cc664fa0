//! Kernels of a training step after the frame: loss, gradients, update.

use super::chain::{ChainKernels, GeometryPass};
use super::colors::ColorUpdate;
use super::config::TrainConfig;
use super::device::DeviceState;
use super::gradients::Gradients;
use super::loss_pass::LossPass;
use super::photos::Bound;
use super::schedule;
use super::step::Step;
use crate::Result;
use crate::gpu::{Gpu, Groups, Readback, Recorder};
use crate::kernels::{adam, adam_color, perturb};
use crate::layout::{GEOMETRY_PLANES, PART_ALL};
use crate::render::{Block, Forward, Model, Scratch};
use crate::scene::Primitive;

/// The kernels, compiled for one device.
#[derive(Debug)]
pub(crate) struct Backward {
    loss: LossPass,
    chain: ChainKernels,
    /// If the run has terms of geometry, for the steps that have them.
    geometry: Option<GeometryPass>,
    adam: adam::Adam,
    /// One kernel per SH degree.
    adam_color: Vec<adam_color::AdamColor>,
    perturb: perturb::Perturb,
}

/// True if a step with these weights has terms of geometry.
fn has_terms(weights: [f32; 2]) -> bool {
    weights.iter().any(|&weight| weight > 0.0)
}

impl Backward {
    /// Compiles the kernels.
    pub(crate) fn new(gpu: &Gpu, config: &TrainConfig) -> Result<Backward> {
        let mut perturb = perturb::Choice::default();
        perturb.spec.surfel = (config.kind == Primitive::Surfel).into();
        Ok(Backward {
            loss: LossPass::new(gpu, config)?,
            chain: ChainKernels::new(gpu, config, config.plain_outputs())?,
            geometry: GeometryPass::new(gpu, config)?,
            adam: adam::Adam::new(gpu, adam::Choice::default())?,
            adam_color: (0..=config.sh_degree)
                .map(|degree| adam_color::AdamColor::new(gpu, adam_color::Choice::of_degree(degree)))
                .collect::<Result<_>>()?,
            perturb: perturb::Perturb::new(gpu, perturb)?,
        })
    }

    /// Compiles further kernels that steps of `model` need with SH up to `sh_degree` and these weights of the terms of
    /// geometry. Required before the first of them.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, model: &Model, sh_degree: u32, geometry: [f32; 2]) -> Result<()> {
        match self.geometry.as_mut().filter(|_| has_terms(geometry)) {
            Some(pass) => pass.prepare(gpu, model, sh_degree),
            None => self.chain.prepare(gpu, model, sh_degree),
        }
    }

    /// Kernels of the frame for steps with these weights of the terms of geometry; `None`: as without terms.
    pub(crate) fn forward(&self, geometry: [f32; 2]) -> Option<&Forward> {
        self.geometry_at(geometry).map(|pass| &pass.forward)
    }

    fn geometry_at(&self, weights: [f32; 2]) -> Option<&GeometryPass> {
        self.geometry.as_ref().filter(|_| has_terms(weights))
    }

    /// Records the kernels of a step after the frame. With depth bands or parts, gradients of all blocks exist at once,
    /// and `state` must have buffers for them. A step in parts is updated by [`Backward::record_end`]. Returns the
    /// residuals of the photograph's patches, if it has them.
    pub(crate) fn record(
        &self,
        rec: &mut Recorder<'_>,
        state: &DeviceState,
        scratch: &Scratch,
        gradients: &Gradients,
        photo: &Bound,
        step: &Step<'_>,
    ) -> Result<Option<Readback<[f32; 4]>>> {
        let is_whole = step.part == PART_ALL;
        if !is_whole {
            // Rows of the halo have no gradient.
            rec.fill(&gradients.d_image, 0);
        }
        let residuals = self.loss.record(rec, scratch, gradients, photo, step)?;
        let kernels = match self.geometry_at(step.geometry) {
            Some(pass) => {
                pass.record(rec, scratch, gradients, step);
                &pass.chain
            }
            None => &self.chain,
        };
        let blocks = || state.model.blocks.of(state.model.counts);
        let Some(replay) = &scratch.replay else {
            let ends = &scratch.isect_end_from_pixel;
            kernels.record_rasterize(rec, scratch, gradients, step, (0, ends));
            // Block by block: only one block's gradients exist at a time.
            for block in blocks() {
                kernels.record_project(rec, state, scratch, gradients, step, block);
                if is_whole {
                    self.record_update(rec, state, scratch, step, block);
                }
            }
            return Ok(residuals);
        };
        let tiles = (step.view.tiles[0] * step.view.tiles[1]) as usize;
        for band in (0..step.bands.count).rev() {
            let is_farthest = band + 1 == step.bands.count;
            let again = (band, step.bands);
            let turn = if is_farthest { 1 } else { 2 };
            step.forward.relist(rec, scratch, replay, tiles, again);
            let ends = replay.isect_end_from_pixel(band);
            kernels.record_rasterize(rec, scratch, gradients, step, (turn, ends));
            blocks().for_each(|b| kernels.record_project(rec, state, scratch, gradients, step, b));
        }
        for block in blocks().filter(|_| is_whole) {
            self.record_update(rec, state, scratch, step, block);
        }
        Ok(residuals)
    }

    /// Records the end of a step in parts: gradients from the sums of all parts' records, and the update. `step` is of
    /// the whole photograph.
    pub(crate) fn record_end(
        &self,
        rec: &mut Recorder<'_>,
        state: &DeviceState,
        scratch: &Scratch,
        gradients: &Gradients,
        step: &Step<'_>,
    ) {
        step.forward
            .record_projection(rec, &state.model, scratch, step.view, step.sh_degree);
        let kernels = self.geometry_at(step.geometry).map_or(&self.chain, |pass| &pass.chain);
        for block in state.model.blocks.of(state.model.counts) {
            kernels.record_project(rec, state, scratch, gradients, step, block);
            self.record_update(rec, state, scratch, step, block);
        }
    }

    /// The update of a block.
    fn record_update(&self, rec: &mut Recorder<'_>, state: &DeviceState, s: &Scratch, step: &Step<'_>, block: Block) {
        let (config, iteration, extent) = (step.config, step.iteration, step.extent);
        let (rates, share) = (&config.rates, schedule::rate_share(config, iteration));
        let [correction1, correction2] = schedule::bias_corrections(config, iteration);
        let (splat_count, stride) = (block.count as u32, block.stride as u32);
        let row = splat_count.div_ceil(self.adam.workgroup);
        self.adam.record(
            rec,
            adam::Bindings {
                counts: &s.counts,
                d_params: state.gradients(block),
                params: &state.model.params[block.index],
                moment1: &state.moments.moment1[block.index],
                moment2: &state.moments.moment2[block.index],
                d_colors: &state.buffers.d_colors[block.index],
            },
            adam::Params {
                first_splat: block.first as u32,
                splat_count,
                stride,
                rate_mean: schedule::mean_rate(config, extent, iteration),
                rate_opacity: share * rates.opacity,
                rate_quaternion: share * rates.quaternion,
                rate_log_scale: share * rates.log_scale,
                beta1: config.adam.beta1,
                beta2: config.adam.beta2,
                epsilon: config.adam.epsilon,
                correction1,
                correction2,
                log_aspect_max: config.max_aspect.max(1.0).ln(),
                color_step: step.color.number,
            },
            Groups::Grid([row, GEOMETRY_PLANES + 1, 1]),
        );
        if let Some(update) = &step.color.update {
            self.record_harmonics(rec, state, s, step, (block, update));
        }
        let amplitude = schedule::noise_scale(config, extent, iteration);
        if amplitude > 0.0 {
            let at = state.model.places(&block);
            self.perturb.record(
                rec,
                perturb::Bindings {
                    counts: &s.counts,
                    params: &state.model.params[block.index],
                    splat_from_slot: &at.splat_from_slot,
                },
                perturb::Params {
                    first_splat: block.first as u32,
                    splat_count,
                    stride,
                    seed: (config.seed ^ (config.seed >> 32)) as u32,
                    step: iteration,
                    amplitude,
                    indexed: state.model.is_indexed().into(),
                },
                self.perturb.groups(block.count),
            );
        }
        rec.timestamp("adam");
    }

    /// Update of the harmonics.
    fn record_harmonics(
        &self,
        rec: &mut Recorder<'_>,
        state: &DeviceState,
        s: &Scratch,
        step: &Step<'_>,
        (block, update): (Block, &ColorUpdate),
    ) {
        let (rates, adam) = (&step.config.rates, &step.config.adam);
        let share = schedule::rate_share(step.config, step.iteration);
        let kernel = &self.adam_color[step.sh_degree.min(block.degree) as usize];
        kernel.record(
            rec,
            adam_color::Bindings {
                counts: &s.counts,
                d_colors: &state.buffers.d_colors[block.index],
                params: &state.model.params[block.index],
                moment1: &state.moments.moment1[block.index],
                moment2: &state.moments.moment2[block.index],
            },
            adam_color::Params {
                splat_count: block.count as u32,
                stride: block.stride as u32,
                step_count: update.steps,
                rate_sh_dc: share * rates.sh_dc,
                rate_sh_rest: share * rates.sh_rest,
                beta1: adam.beta1,
                beta2: adam.beta2,
                epsilon: adam.epsilon,
                position: update.position,
                correction1: update.correction1,
                correction2: update.correction2,
                look_ahead: update.look_ahead,
            },
            kernel.groups(block.count),
        );
    }
}
