//! Kernels of a training step after the frame: loss, gradients, update.

use super::config::{ExposureModel, TrainConfig};
use super::device::DeviceState;
use super::photos::Bound;
use super::pose_pass::PosePass;
use super::schedule;
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups, PART_ALIGNMENT, Recorder};
use crate::kernels::project_backward::ProjectBackward;
use crate::kernels::{adam, adam_color, loss, loss_backward, loss_exposure, loss_sum};
use crate::kernels::{perturb, project_backward, rasterize_backward};
use crate::layout::{EXPOSURE_PIXELS, GEOMETRY_PLANES, LOSS_TILE_HEIGHT, LOSS_TILE_WIDTH, SURFEL_REST, View};
use crate::render::{
    Allocate, Block, Capacity, DepthBands, Forward, Model, Need, Purpose, Scratch, buffers, tile_stride,
};
use crate::scene::Primitive;

/// Value of `alpha_mode` that makes alpha a weight (`ALPHA_MASKS` in photo.glsl).
const ALPHA_MASKS: u32 = 1;

/// The kernels, compiled for one device.
#[derive(Debug)]
pub(crate) struct Backward {
    loss: loss::Loss,
    loss_backward: loss_backward::LossBackward,
    /// If photographs have exposures.
    loss_exposure: Option<loss_exposure::LossExposure>,
    loss_sum: loss_sum::LossSum,
    rasterize: rasterize_backward::RasterizeBackward,
    /// One kernel per SH degree.
    project: Vec<ProjectBackward>,
    /// The same for slots in an order of their own; empty until a model has one.
    indexed: Vec<ProjectBackward>,
    pose: PosePass,
    adam: adam::Adam,
    /// One kernel per SH degree.
    adam_color: Vec<adam_color::AdamColor>,
    perturb: perturb::Perturb,
}

buffers! {
    /// Buffers of a step beyond those of rendering.
    pub(crate) struct Gradients(capacity: Capacity, primitive: Primitive) {
        records: Records, Intersections, (capacity, primitive);
        /// An image of these tiles has at most as many loss tiles as compositing tiles.
        loss_from_tile: Buffer<[f32; 4]>, Pixels, capacity.tiles;
        /// Of the loss, and both sums of the photograph's gains.
        loss: Buffer<[f32; 4]>, Pixels, 3;
        d_image: Buffer<f32>, Pixels, 3 * capacity.pixels;
    }
}

/// Words of the gradients of a (splat, tile) pair in each of three arrays.
pub(crate) fn record_widths(primitive: Primitive) -> [usize; 3] {
    match primitive {
        Primitive::Gaussian3d => [4, 4, 1],
        Primitive::Surfel => [4, 4, SURFEL_REST as usize],
    }
}

/// Gradients of every (splat, tile) pair in three arrays, in one buffer with the slopes of SSIM: these are last read
/// before the first record is written.
#[derive(Clone, Debug)]
pub(crate) struct Records {
    ssim_slope: Buffer<[f32; 3]>,
    d_shape_from_source: Buffer<[f32; 4]>,
    d_tone_from_source: Buffer<[f32; 4]>,
    d_rest_from_source: Buffer<f32>,
}

impl Allocate for Records {
    type Size = (Capacity, Primitive);

    fn allocate(gpu: &Gpu, name: &str, (capacity, primitive): Self::Size) -> Result<Records> {
        let (slopes, isects) = (9 * capacity.pixels, capacity.isects);
        let widths = record_widths(primitive);
        let widest = widths.into_iter().max().unwrap_or(0);
        gpu.check_reach("d_shape_from_source", (4 * widest * isects) as u64)?;
        gpu.check_reach("ssim_slope", 4 * slopes as u64)?;
        let padded = isects.next_multiple_of(PART_ALIGNMENT);
        let records = gpu.room::<f32>(name, slopes.max(widths.iter().sum::<usize>() * padded))?;
        let array = |begin: usize, width: usize| records.part(begin..begin + width * isects);
        Ok(Records {
            ssim_slope: records.part(0..slopes).cast(),
            d_shape_from_source: array(0, widths[0]).cast(),
            d_tone_from_source: array(widths[0] * padded, widths[1]).cast(),
            d_rest_from_source: array((widths[0] + widths[1]) * padded, widths[2]),
        })
    }

    /// Of the slopes, only what they need beyond the records counts as theirs.
    fn needs(name: &'static str, purpose: Purpose, (capacity, primitive): Self::Size) -> Vec<Need> {
        let width: usize = record_widths(primitive).iter().sum();
        let records = width * capacity.isects.next_multiple_of(PART_ALIGNMENT);
        let slopes = (9 * capacity.pixels).saturating_sub(records);
        vec![
            Need::new(name, purpose, 4, records),
            Need::new("ssim_slope", Purpose::Pixels, 4, slopes),
        ]
    }
}

/// Inputs of a step.
pub(crate) struct Step<'a> {
    pub(crate) config: &'a TrainConfig,
    pub(crate) forward: &'a Forward,
    pub(crate) iteration: u32,
    /// Scene extent in world units.
    pub(crate) extent: f64,
    pub(crate) view: &'a View,
    pub(crate) sh_degree: u32,
    pub(crate) bands: DepthBands,
    /// Gains of the photograph, and slopes on the curve's toe.
    pub(crate) exposure: [[f32; 3]; 2],
    /// Offset of the lattice of SSIM's windows, pixels.
    pub(crate) window_offset: [u32; 2],
}

/// Exposure of photographs without one.
pub(crate) const UNEXPOSED: [[f32; 3]; 2] = [[1.0; 3]; 2];

impl Backward {
    /// Compiles the kernels.
    pub(crate) fn new(gpu: &Gpu, config: &TrainConfig) -> Result<Backward> {
        let mut loss = loss::Choice::default();
        let mut loss_backward = loss_backward::Choice::default();
        let with_ssim = u32::from(config.lambda_dssim > 0.0);
        (loss.spec.with_ssim, loss_backward.spec.with_ssim) = (with_ssim, with_ssim);
        let stride = schedule::window_stride(config);
        (loss.spec.stride, loss_backward.spec.stride) = (stride, stride);
        let has_exposure = config.exposure != ExposureModel::Off;
        loss.spec.with_exposure = has_exposure.into();
        loss_backward.spec.with_exposure = has_exposure.into();
        let exposure = || loss_exposure::LossExposure::new(gpu, loss_exposure::Choice::default());
        let mut rasterize = rasterize_backward::Choice::prefer(gpu.caps());
        rasterize.spec.log2_alpha_min = config.accuracy.log2_alpha_min();
        let is_surfel = config.kind == Primitive::Surfel;
        rasterize.spec.surfel = is_surfel.into();
        let mut perturb = perturb::Choice::default();
        perturb.spec.surfel = is_surfel.into();
        use rasterize_backward::RasterizeBackward;
        Ok(Backward {
            loss: loss::Loss::new(gpu, loss)?,
            loss_backward: loss_backward::LossBackward::new(gpu, loss_backward)?,
            loss_exposure: has_exposure.then(exposure).transpose()?,
            loss_sum: loss_sum::LossSum::new(gpu, loss_sum::Choice::default())?,
            rasterize: RasterizeBackward::new(gpu, rasterize)?,
            project: ProjectBackward::of_degrees(gpu, config.sh_degree, false, is_surfel)?,
            indexed: Vec::new(),
            pose: PosePass::new(gpu, config)?,
            adam: adam::Adam::new(gpu, adam::Choice::default())?,
            adam_color: (0..=config.sh_degree)
                .map(|degree| adam_color::AdamColor::new(gpu, adam_color::Choice::of_degree(degree)))
                .collect::<Result<_>>()?,
            perturb: perturb::Perturb::new(gpu, perturb)?,
        })
    }

    /// Compiles further kernels that steps of `model` need. Required before the first of them.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, model: &Model) -> Result<()> {
        if model.is_indexed() && self.indexed.is_empty() {
            let highest = self.project.len() as u32 - 1;
            self.indexed = ProjectBackward::of_degrees(gpu, highest, true, model.primitive == Primitive::Surfel)?;
        }
        Ok(())
    }

    /// Records the kernels of a step after the frame. With depth bands, gradients of all blocks exist at once, and
    /// `state` must have buffers for them.
    pub(crate) fn record(
        &self,
        rec: &mut Recorder<'_>,
        state: &DeviceState,
        scratch: &Scratch,
        gradients: &Gradients,
        photo: &Bound,
        step: &Step<'_>,
    ) {
        self.record_loss(rec, scratch, gradients, photo, step);
        let blocks = || state.model.blocks.of(state.model.counts);
        let Some(replay) = &scratch.replay else {
            let ends = &scratch.isect_end_from_pixel;
            self.record_rasterize(rec, scratch, gradients, step, (0, ends));
            // Block by block: only one block's gradients exist at a time.
            for block in blocks() {
                self.record_project(rec, state, scratch, gradients, step, block);
                self.pose.record(rec, state, scratch, step.sh_degree, block);
                self.record_update(rec, state, scratch, step, block);
            }
            return;
        };
        let tiles = (step.view.tiles[0] * step.view.tiles[1]) as usize;
        for band in (0..step.bands.count).rev() {
            let is_farthest = band + 1 == step.bands.count;
            let again = (band, step.bands);
            let turn = if is_farthest { 1 } else { 2 };
            step.forward.relist(rec, scratch, replay, tiles, again);
            let ends = replay.isect_end_from_pixel(band);
            self.record_rasterize(rec, scratch, gradients, step, (turn, ends));
            blocks().for_each(|b| self.record_project(rec, state, scratch, gradients, step, b));
        }
        for block in blocks() {
            self.pose.record(rec, state, scratch, step.sh_degree, block);
            self.record_update(rec, state, scratch, step, block);
        }
    }

    fn record_loss(&self, rec: &mut Recorder<'_>, s: &Scratch, g: &Gradients, photo: &Bound, step: &Step<'_>) {
        let [width, height] = step.view.size;
        let tiles = width.div_ceil(LOSS_TILE_WIDTH) * height.div_ceil(LOSS_TILE_HEIGHT);
        let alpha_mode = if photo.masks { ALPHA_MASKS } else { 0 };
        let lambda = f64::from(step.config.lambda_dssim);
        let [gain, toe] = step.exposure;
        self.loss.record(
            rec,
            loss::Bindings {
                view: &s.view,
                image: &s.image,
                photo: &photo.pixels,
                ssim_slope: &g.records.ssim_slope,
                loss_from_tile: &g.loss_from_tile,
            },
            loss::Params {
                alpha_mode,
                gain,
                toe,
                offset: step.window_offset,
            },
            Groups::Count(tiles),
        );
        self.record_sum(rec, (&g.loss_from_tile, tiles), g, [0, 1, 0]);
        rec.timestamp("loss");
        // A fully masked photograph has zero gradient.
        let share = if photo.weight > 0.0 {
            1.0 / (3.0 * photo.weight)
        } else {
            0.0
        };
        self.loss_backward.record(
            rec,
            loss_backward::Bindings {
                view: &s.view,
                image: &s.image,
                photo: &photo.pixels,
                ssim_slope: &g.records.ssim_slope,
                d_image: &g.d_image,
            },
            loss_backward::Params {
                alpha_mode,
                l1_scale: ((1.0 - lambda) * share) as f32,
                ssim_scale: (lambda * share) as f32,
                gain,
                toe,
                offset: step.window_offset,
            },
            Groups::Count(tiles),
        );
        self.record_exposure(rec, s, g, photo, step);
        rec.timestamp("loss_backward");
    }

    /// Adds up every `stride`-th of the terms from the `first` on into a slot of the totals.
    fn record_sum(
        &self,
        rec: &mut Recorder<'_>,
        (terms, tile_count): (&Buffer<[f32; 4]>, u32),
        g: &Gradients,
        [first, stride, slot]: [u32; 3],
    ) {
        self.loss_sum.record(
            rec,
            loss_sum::Bindings {
                loss_from_tile: terms,
                total: &g.loss,
            },
            loss_sum::Params {
                tile_count,
                first,
                stride,
                slot,
            },
            Groups::Count(1),
        );
    }

    /// Sums for the photograph's gains, in the place of SSIM's slopes, which have been read.
    fn record_exposure(&self, rec: &mut Recorder<'_>, s: &Scratch, g: &Gradients, photo: &Bound, step: &Step<'_>) {
        let Some(kernel) = &self.loss_exposure else {
            return;
        };
        let [width, height] = step.view.size;
        let groups = (width * height).div_ceil(EXPOSURE_PIXELS);
        let partials = g.records.ssim_slope.cast::<[f32; 4]>();
        let [gain, toe] = step.exposure;
        kernel.record(
            rec,
            loss_exposure::Bindings {
                view: &s.view,
                image: &s.image,
                photo: &photo.pixels,
                sums_from_group: &partials,
            },
            loss_exposure::Params {
                alpha_mode: if photo.masks { ALPHA_MASKS } else { 0 },
                gain,
                toe,
            },
            Groups::Count(groups),
        );
        for slot in [1, 2] {
            self.record_sum(rec, (&partials, groups), g, [slot - 1, 2, slot]);
        }
    }

    fn record_rasterize(
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

    fn record_project(
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
        let kernels = match state.model.is_indexed() {
            true => &self.indexed,
            false => &self.project,
        };
        let kernel = &kernels[step.sh_degree.min(block.degree) as usize];
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
                banded: s.replay.is_some().into(),
            },
            kernel.groups(block.count),
        );
        rec.timestamp("project_backward");
    }

    fn record_update(&self, rec: &mut Recorder<'_>, state: &DeviceState, s: &Scratch, step: &Step<'_>, block: Block) {
        let (config, iteration, extent) = (step.config, step.iteration, step.extent);
        let rates = &config.rates;
        let [correction1, correction2] = schedule::bias_corrections(config, iteration);
        let (splat_count, stride) = (block.count as u32, block.stride as u32);
        let row = splat_count.div_ceil(self.adam.workgroup);
        self.adam.record(
            rec,
            adam::Bindings {
                counts: &s.counts,
                d_params: state.gradients(block),
                params: &state.model.params[block.index],
                moment1: &state.buffers.moment1[block.index],
                moment2: &state.buffers.moment2[block.index],
            },
            adam::Params {
                first_splat: block.first as u32,
                splat_count,
                stride,
                rate_mean: schedule::mean_rate(config, extent, iteration),
                rate_opacity: rates.opacity,
                rate_quaternion: rates.quaternion,
                rate_log_scale: rates.log_scale,
                beta1: config.adam.beta1,
                beta2: config.adam.beta2,
                epsilon: config.adam.epsilon,
                correction1,
                correction2,
                log_aspect_max: config.max_aspect.max(1.0).ln(),
            },
            Groups::Grid([row, GEOMETRY_PLANES, 1]),
        );
        self.record_harmonics(rec, state, s, step, block);
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

    /// Adam of the harmonics.
    fn record_harmonics(
        &self,
        rec: &mut Recorder<'_>,
        state: &DeviceState,
        s: &Scratch,
        step: &Step<'_>,
        block: Block,
    ) {
        let (rates, adam) = (&step.config.rates, &step.config.adam);
        let [correction1, correction2] = schedule::bias_corrections(step.config, step.iteration);
        let kernel = &self.adam_color[step.sh_degree.min(block.degree) as usize];
        kernel.record(
            rec,
            adam_color::Bindings {
                counts: &s.counts,
                d_params: state.gradients(block),
                params: &state.model.params[block.index],
                moment1: &state.buffers.moment1[block.index],
                moment2: &state.buffers.moment2[block.index],
            },
            adam_color::Params {
                first_splat: block.first as u32,
                splat_count: block.count as u32,
                stride: block.stride as u32,
                rate_sh_dc: rates.sh_dc,
                rate_sh_rest: rates.sh_rest,
                beta1: adam.beta1,
                beta2: adam.beta2,
                epsilon: adam.epsilon,
                correction1,
                correction2,
            },
            kernel.groups(block.count),
        );
    }
}
