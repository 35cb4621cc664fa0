//! Kernels of a step that compare the frame with its photograph.

use super::config::{ExposureModel, TrainConfig};
use super::gradients::Gradients;
use super::photos::Bound;
use super::schedule;
use super::step::Step;
use super::transients::PatchGrid;
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups, PART_ALIGNMENT, Readback, Recorder};
use crate::kernels::{loss, loss_backward, loss_exposure, loss_residual, loss_sum};
use crate::layout::{EXPOSURE_PIXELS, LOSS_TILE_HEIGHT, LOSS_TILE_WIDTH, PART_ALL};
use crate::render::Scratch;

/// Value of `alpha_mode` that makes alpha a weight (`ALPHA_MASKS` in photo.glsl).
const ALPHA_MASKS: u32 = 1;

/// The loss, its gradient, and sums for the states of the photographs.
#[derive(Debug)]
pub(super) struct LossPass {
    loss: loss::Loss,
    loss_backward: loss_backward::LossBackward,
    /// If photographs have exposures.
    loss_exposure: Option<loss_exposure::LossExposure>,
    /// If patches of photographs are left out.
    loss_residual: Option<loss_residual::LossResidual>,
    loss_sum: loss_sum::LossSum,
}

impl LossPass {
    /// Compiles the kernels that a run needs.
    pub(super) fn new(gpu: &Gpu, config: &TrainConfig) -> Result<LossPass> {
        let mut loss = loss::Choice::prefer(gpu.caps());
        let mut loss_backward = loss_backward::Choice::prefer(gpu.caps());
        let mut loss_exposure = loss_exposure::Choice::default();
        let mut loss_residual = loss_residual::Choice::default();
        let with_ssim = u32::from(config.lambda_dssim > 0.0);
        (loss.spec.with_ssim, loss_backward.spec.with_ssim) = (with_ssim, with_ssim);
        let stride = schedule::window_stride(config);
        (loss.spec.stride, loss_backward.spec.stride) = (stride, stride);
        let has_exposure = config.exposure != ExposureModel::Off;
        let with_exposure = has_exposure.into();
        loss.spec.with_exposure = with_exposure;
        loss_backward.spec.with_exposure = with_exposure;
        loss_residual.spec.with_exposure = with_exposure;
        let with_ignored = config.ignore_transients.into();
        loss.spec.with_ignored = with_ignored;
        loss_backward.spec.with_ignored = with_ignored;
        loss_exposure.spec.with_ignored = with_ignored;
        let exposure = || loss_exposure::LossExposure::new(gpu, loss_exposure);
        let residual = || loss_residual::LossResidual::new(gpu, loss_residual);
        Ok(LossPass {
            loss: loss::Loss::new(gpu, loss)?,
            loss_backward: loss_backward::LossBackward::new(gpu, loss_backward)?,
            loss_exposure: has_exposure.then(exposure).transpose()?,
            loss_residual: config.ignore_transients.then(residual).transpose()?,
            loss_sum: loss_sum::LossSum::new(gpu, loss_sum::Choice::default())?,
        })
    }

    /// Records the kernels; returns the residuals of the photograph's patches, if it has them.
    pub(super) fn record(
        &self,
        rec: &mut Recorder<'_>,
        s: &Scratch,
        g: &Gradients,
        photo: &Bound,
        step: &Step<'_>,
    ) -> Result<Option<Readback<[f32; 4]>>> {
        let columns = step.view.size[0].div_ceil(LOSS_TILE_WIDTH);
        let (photo_part, photo_first) = photo_part(photo, step);
        let [_, reached] = tile_rows(step);
        let tiles = columns * reached.1;
        let alpha_mode = alpha_mode(photo);
        let [gain, toe] = step.exposure;
        let (patch_shift, patch_columns) = grid(step);
        self.loss.record(
            rec,
            loss::Bindings {
                view: &s.view,
                image: &s.image,
                photo: &photo_part,
                ssim_slope: &g.records.ssim_slope,
                loss_from_tile: &g.loss_from_tile,
                ignored: &g.ignored,
            },
            loss::Params {
                alpha_mode,
                gain,
                toe,
                offset: step.window_offset,
                patch_shift,
                patch_columns,
                photo_first,
                photo_rows: step.size[1] - step.rows.first,
                counted: step.rows.counted,
                tile_row: reached.0,
                tile_rows: reached.1,
            },
            Groups::Count(tiles),
        );
        self.record_sum(rec, (&g.loss_from_tile, tiles), g, [0, 1, 0]);
        rec.timestamp("loss");
        self.record_backward(rec, s, g, photo, step);
        self.record_exposure(rec, s, g, photo, step);
        let residuals = self.record_residuals(rec, s, g, photo, step)?;
        rec.timestamp("loss_backward");
        Ok(residuals)
    }

    /// The gradient by every pixel of the frame.
    fn record_backward(&self, rec: &mut Recorder<'_>, s: &Scratch, g: &Gradients, photo: &Bound, step: &Step<'_>) {
        let columns = step.view.size[0].div_ceil(LOSS_TILE_WIDTH);
        let (photo_part, photo_first) = photo_part(photo, step);
        let [own, _] = tile_rows(step);
        let lambda = f64::from(step.config.lambda_dssim);
        let [gain, toe] = step.exposure;
        let (patch_shift, patch_columns) = grid(step);
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
                photo: &photo_part,
                ssim_slope: &g.records.ssim_slope,
                d_image: &g.d_image,
                ignored: &g.ignored,
            },
            loss_backward::Params {
                alpha_mode: alpha_mode(photo),
                l1_scale: ((1.0 - lambda) * share) as f32,
                ssim_scale: (lambda * share) as f32,
                gain,
                toe,
                offset: step.window_offset,
                patch_shift,
                patch_columns,
                photo_first,
                tile_row: own.0,
                tile_rows: own.1,
            },
            Groups::Count(columns * own.1),
        );
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
        let counted = step.rows.counted;
        let groups = (step.view.size[0] * (counted[1] - counted[0])).div_ceil(EXPOSURE_PIXELS);
        let (photo_part, photo_first) = photo_part(photo, step);
        let partials = g.records.ssim_slope.cast::<[f32; 4]>();
        let [gain, toe] = step.exposure;
        let (patch_shift, patch_columns) = grid(step);
        kernel.record(
            rec,
            loss_exposure::Bindings {
                view: &s.view,
                image: &s.image,
                photo: &photo_part,
                sums_from_group: &partials,
                ignored: &g.ignored,
            },
            loss_exposure::Params {
                alpha_mode: alpha_mode(photo),
                gain,
                toe,
                patch_shift,
                patch_columns,
                photo_first,
                counted,
            },
            Groups::Count(groups),
        );
        for slot in [1, 2] {
            self.record_sum(rec, (&partials, groups), g, [slot - 1, 2, slot]);
        }
    }

    /// Residuals of the photograph's patches, in the place of SSIM's slopes likewise.
    fn record_residuals(
        &self,
        rec: &mut Recorder<'_>,
        s: &Scratch,
        g: &Gradients,
        photo: &Bound,
        step: &Step<'_>,
    ) -> Result<Option<Readback<[f32; 4]>>> {
        let (Some(kernel), Some(patches)) = (&self.loss_residual, step.patches) else {
            return Ok(None);
        };
        let residuals = g.records.ssim_slope.cast::<[f32; 4]>();
        let (photo_part, photo_first) = photo_part(photo, step);
        let [gain, toe] = step.exposure;
        kernel.record(
            rec,
            loss_residual::Bindings {
                view: &s.view,
                image: &s.image,
                photo: &photo_part,
                residual_from_patch: &residuals,
            },
            loss_residual::Params {
                alpha_mode: alpha_mode(photo),
                gain,
                toe,
                patch_shift: patches.shift,
                patch_columns: patches.columns,
                photo_first,
                counted: step.rows.counted,
            },
            Groups::Count(patches.count() as u32),
        );
        rec.read_back(&residuals, 0..patches.count()).map(Some)
    }
}

/// The rows of the photograph that the drawn rows are compared with, a tile more on both sides, and the place of the
/// first drawn pixel in them.
fn photo_part(photo: &Bound, step: &Step<'_>) -> (Buffer<u32>, u32) {
    if step.part == PART_ALL {
        return (photo.pixels.clone(), 0);
    }
    let ([width, height], rows) = (step.size, step.rows);
    let place = |row: u32| row as usize * width as usize;
    let begin = place(rows.first.saturating_sub(LOSS_TILE_HEIGHT)) / PART_ALIGNMENT * PART_ALIGNMENT;
    let end = place(height.min(rows.first + rows.rows + LOSS_TILE_HEIGHT));
    (photo.pixels.part(begin..end), (place(rows.first) - begin) as u32)
}

/// First row and number of rows of the loss tiles that count, and of those with windows that reach them. The first row
/// is relative to the drawn rows and may lie above them, as a negative number.
fn tile_rows(step: &Step<'_>) -> [(u32, u32); 2] {
    let ([begin, end], drawn) = (step.rows.counted, step.rows.rows);
    let own = (begin, (end - begin).div_ceil(LOSS_TILE_HEIGHT));
    let above = u32::from(begin > 0);
    let below = u32::from(end < drawn);
    let first = begin.wrapping_sub(above * LOSS_TILE_HEIGHT);
    [own, (first, above + own.1 + below)]
}

fn alpha_mode(photo: &Bound) -> u32 {
    if photo.masks { ALPHA_MASKS } else { 0 }
}

/// Shift and columns of the step's patches; without them, all pixels belong to the first.
fn grid(step: &Step<'_>) -> (u32, u32) {
    step.patches
        .map_or((31, 0), |PatchGrid { shift, columns, .. }| (shift, columns))
}
