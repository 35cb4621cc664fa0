//! Steps recorded, and their reports. A photograph whose arrays exceed a binding of the device is drawn in bands of
//! rows: the records of all bands are summed before the gradients.

use super::{Coarse, StepReport, Trainer};
use crate::Result;
use crate::gpu::{Readback, Recorder, Ticket};
use crate::layout::*;
use crate::render::{RowBand, Scratch, ViewOptions, view_of};
use crate::scene::{Camera, Dataset};
use crate::train::backward::Backward;
use crate::train::device::DeviceState;
use crate::train::gradients::Gradients;
use crate::train::memory::{BufferLimits, row_bands};
use crate::train::photos::{Bound, Photos};
use crate::train::schedule;
use crate::train::step::{Step, UNEXPOSED};

/// A step in flight.
pub(super) struct StepInFlight {
    pub(super) iteration: u32,
    pub(super) ticket: Ticket,
    /// Counts at the end.
    counts: Readback<u32>,
    /// Counts and sums of each band of the photograph.
    bands: Vec<BandSums>,
    splat_count: usize,
    /// Place of the photograph among the views trained on.
    pub(super) photo: usize,
}

/// Readbacks of a band.
struct BandSums {
    /// Counts after its frame, if there are several bands.
    counts: Option<Readback<u32>>,
    loss: Readback<[f32; 4]>,
    /// Residuals of the photograph's patches, if the run ignores transients.
    residuals: Option<Readback<[f32; 4]>>,
}

impl StepInFlight {
    /// Counts of the first band that did not fit, else of all: the most pairs of a band and the pairs of all.
    fn counts(&self) -> (Vec<u32>, usize, usize) {
        let last = self.counts.get();
        let bands: Vec<Vec<u32>> = self
            .bands
            .iter()
            .filter_map(|band| Some(band.counts.as_ref()?.get()))
            .collect();
        let wanted = |counts: &Vec<u32>| counts[COUNT_ISECT_WANTED as usize] as usize;
        if bands.is_empty() {
            let wanted = wanted(&last);
            return (last, wanted, wanted);
        }
        let all = bands.iter().map(wanted).sum();
        if let Some(failed) = bands.iter().find(|counts| counts[COUNT_FAILED as usize] != 0) {
            return (failed.clone(), wanted(failed), all);
        }
        let most = bands.iter().map(wanted).max().unwrap_or(0);
        (last, most, all)
    }

    /// Sums of the loss and of the photograph's gains, over the bands from the top.
    fn loss(&self) -> Vec<[f64; 4]> {
        let mut total = vec![[0.0; 4]; 3];
        for band in &self.bands {
            for (total, sums) in total.iter_mut().zip(band.loss.get()) {
                (0..4).for_each(|i| total[i] += f64::from(sums[i]));
            }
        }
        total
    }

    /// Residuals of the photograph's patches, if the run ignores transients.
    pub(super) fn residuals(&self) -> Option<Vec<[f32; 4]>> {
        let mut bands = self.bands.iter().filter_map(|band| band.residuals.as_ref());
        let mut total = bands.next()?.get();
        for band in bands {
            for (total, sums) in total.iter_mut().zip(band.get()) {
                (0..4).for_each(|i| total[i] += sums[i]);
            }
        }
        Some(total)
    }
}

impl Trainer<'_> {
    /// Bands of a photograph.
    pub(super) fn row_bands(&self, camera: &Camera) -> Vec<RowBand> {
        let size = [camera.width, camera.height];
        let binding = BufferLimits::of(&self.gpu).step_binding(&self.config);
        row_bands(size, self.config.outputs(), binding).each().collect()
    }

    /// Compiles the kernels that a step needs besides those of earlier ones.
    fn compile(&mut self, sh_degree: u32, geometry: [f32; 2]) -> Result<()> {
        let model = &self.state.model;
        if self.backward.forward(geometry).is_none() {
            self.forward.prepare(&self.gpu, model, sh_degree)?;
        }
        self.backward.prepare(&self.gpu, model, sh_degree, geometry)
    }

    pub(super) fn submit(&mut self, iteration: u32) -> Result<StepInFlight> {
        let sh_degree = schedule::sh_degree(&self.config, iteration);
        let geometry = schedule::geometry(&self.config, iteration);
        self.compile(sh_degree, geometry)?;
        let index = schedule::view(&self.config, self.views.len(), iteration);
        let (dataset, camera) = match &self.coarse {
            Some(Coarse { dataset, .. }) => (dataset, &dataset.views[index].camera),
            None => (self.dataset, &self.dataset.views[self.views[index]].camera),
        };
        let options = ViewOptions {
            background: schedule::background(&self.config, iteration),
            near: self.near(),
            filter: self.config.filter,
        };
        let model = &self.state.model;
        let mut view = view_of(&self.refined(index, camera), &options);
        if let Some(coarse) = &self.coarse {
            view.dilation *= self.config.coarse_dilation.powi(coarse.halvings as i32);
        }
        [view.dropout, view.dropout_key] = schedule::dropout(&self.config, iteration);
        let bands = self.row_bands(camera);
        let color = self.colors.push(&self.config, iteration, view.position);
        let (patches, ignored) = self.patches(index);
        let step = Step {
            config: &self.config,
            forward: self.backward.forward(geometry).unwrap_or(&self.forward),
            geometry,
            iteration,
            extent: self.extent,
            view: &view,
            rows: RowBand {
                first: 0,
                rows: view.size[1],
                counted: [0, view.size[1]],
            },
            size: view.size,
            part: PART_END,
            sh_degree,
            color,
            bands: self.bands,
            window_offset: schedule::window_offset(&self.config, self.views.len(), iteration),
            exposure: self.exposure.as_ref().map_or(UNEXPOSED, |gains| gains.push(index)),
            patches,
        };
        let (scratch, gradients) = (&self.scratch, &self.gradients);
        let (photos, source) = (&mut self.photos, (dataset, index));
        let frame = StepFrame {
            backward: &self.backward,
            state: &self.state,
            scratch,
            gradients,
        };
        let (ticket, (counts, bands)) = self.frames.submit(|rec| {
            let photo = begin(rec, photos, source, &frame, &ignored)?;
            let sums = frame.record_bands(rec, &photo, &step, &bands)?;
            Ok((rec.read_back(&scratch.counts, 0..COUNT_SLOTS as usize)?, sums))
        })?;
        Ok(StepInFlight {
            iteration,
            ticket,
            counts,
            bands,
            splat_count: model.splat_count,
            photo: index,
        })
    }

    /// Takes the report of the oldest step in flight. False: it did not fit, and training has returned to the iteration
    /// before it.
    pub(super) fn collect(&mut self) -> Result<bool> {
        let Some(oldest) = self.pending.pop_front() else {
            return Ok(true);
        };
        self.frames.wait(oldest.ticket)?;
        let (counts, wanted, isect_count) = oldest.counts();
        self.extremes.isects = self.extremes.isects.max(wanted);
        if counts[COUNT_FAILED as usize] != 0 {
            self.pending
                .drain(..)
                .try_for_each(|later| self.frames.wait(later.ticket))?;
            self.grow_buffers(&counts)?;
            self.iteration = oldest.iteration - 1;
            return Ok(false);
        }
        let sums = oldest.loss();
        let [l1, dssim, square, weight] = sums[0];
        if let Some(exposure) = &mut self.exposure {
            let gains: Vec<[f32; 4]> = sums[1..].iter().map(|four| four.map(|x| x as f32)).collect();
            exposure.add(oldest.photo, &gains);
        }
        self.score_patches(&oldest);
        let lambda = f64::from(self.config.lambda_dssim);
        let share = if weight > 0.0 { 1.0 / weight } else { 0.0 };
        self.done.push_back(StepReport {
            iteration: oldest.iteration,
            loss: ((1.0 - lambda) * l1 + lambda * dssim) * share,
            psnr_db: -10.0 * (square * share).log10(),
            splat_count: oldest.splat_count,
            visible_count: counts[COUNT_VISIBLE as usize] as usize,
            isect_count,
            poisoned: counts[COUNT_POISONED as usize] as usize,
            poisoned_first: match counts[COUNT_POISONED_FIRST as usize] {
                0 => None,
                below_top => Some(self.state.slots.splat((u32::MAX - below_top) as usize)),
            },
            refined: None,
        });
        Ok(true)
    }
}

/// Kernels and buffers of a step.
struct StepFrame<'a> {
    backward: &'a Backward,
    state: &'a DeviceState,
    scratch: &'a Scratch,
    gradients: &'a Gradients,
}

/// Records the inputs of a step.
fn begin(
    rec: &mut Recorder<'_>,
    photos: &mut Photos,
    (dataset, index): (&Dataset, usize),
    frame: &StepFrame<'_>,
    ignored: &[u32],
) -> Result<Bound> {
    let photo = photos.bind(rec, dataset, index)?;
    if !ignored.is_empty() {
        rec.update(&frame.gradients.ignored, 0, ignored);
    }
    rec.update(&frame.scratch.counts, COUNT_POISONED as usize, &[0, 0]);
    rec.timestamp("upload");
    Ok(photo)
}

impl StepFrame<'_> {
    /// Records the bands of a photograph, and the update. `step` is of the whole photograph.
    fn record_bands(
        &self,
        rec: &mut Recorder<'_>,
        photo: &Bound,
        step: &Step<'_>,
        bands: &[RowBand],
    ) -> Result<Vec<BandSums>> {
        let is_whole = bands.len() == 1;
        let part = |index: usize| match index {
            _ if is_whole => PART_ALL,
            0 => PART_FIRST,
            _ => PART_NEXT,
        };
        let sums = bands
            .iter()
            .enumerate()
            .map(|(index, &band)| self.record_band(rec, photo, step, (band, part(index))))
            .collect::<Result<_>>()?;
        if !is_whole {
            self.backward
                .record_end(rec, self.state, self.scratch, self.gradients, step);
        }
        Ok(sums)
    }

    fn record_band(
        &self,
        rec: &mut Recorder<'_>,
        photo: &Bound,
        step: &Step<'_>,
        (rows, part): (RowBand, u32),
    ) -> Result<BandSums> {
        let (scratch, gradients) = (self.scratch, self.gradients);
        let view = &rows.view(step.view);
        let step = &Step {
            view,
            rows,
            part,
            ..*step
        };
        let forward = step.forward;
        forward.record(rec, &self.state.model, scratch, view, step.sh_degree, step.bands);
        let all = 0..COUNT_SLOTS as usize;
        let counts = (part != PART_ALL).then(|| rec.read_back(&scratch.counts, all));
        let counts = counts.transpose()?;
        let residuals = self.backward.record(rec, self.state, scratch, gradients, photo, step)?;
        Ok(BandSums {
            counts,
            loss: rec.read_back(&gradients.loss, 0..3)?,
            residuals,
        })
    }
}
