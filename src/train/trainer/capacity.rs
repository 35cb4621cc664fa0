//! Capacity of a run's buffers. Buffers too small are replaced, the old ones freed first, so that the device never
//! holds both.

use super::Trainer;
use crate::gpu::{Gpu, TRANSFER_BYTES};
use crate::kernels::rasterize::Outputs;
use crate::layout::COUNT_ISECT_WANTED;
use crate::render::{BandReplay, Blocks, ByDegree, Capacity, DepthBands, Model, Scratch, Slots, list_limit, total};
use crate::scene::Camera;
use crate::train::colors::ColorQueue;
use crate::train::config::{StrategyKind, TrainConfig};
use crate::train::device::DeviceState;
use crate::train::gradients::{Gradients, record_widths};
use crate::train::memory::{BufferLimits, TrainSize, row_bands, splats_expected, step_needs, with_margin};
use crate::train::reorder::RefinedRows;
use crate::train::state::HostState;
use crate::{Error, Result};

/// Maxima of a run so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extremes {
    /// Splats at one time.
    pub splats: usize,
    /// Number of these splats by SH degree.
    pub counts: ByDegree,
    /// (Splat, tile) pairs of one frame.
    pub isects: usize,
}

impl Extremes {
    /// Updates the maxima by the splats of the next steps.
    pub(super) fn note(&mut self, degrees: &[u8]) {
        if degrees.len() >= self.splats {
            self.splats = degrees.len();
            self.counts = Slots::of(degrees).counts;
        }
    }
}

/// Largest element, in bytes, of the arrays with one element per (splat, tile) pair.
fn record_bytes(outputs: Outputs) -> u64 {
    4 * record_widths(outputs).into_iter().max().unwrap_or(1) as u64
}

impl Trainer<'_> {
    /// Maxima since the run was begun or resumed.
    pub fn extremes(&self) -> Extremes {
        self.extremes
    }

    /// Input of the memory formula: the maxima so far or, before the first step, the initial splats and estimated
    /// pairs.
    pub fn size(&self) -> TrainSize {
        let (config, limits) = (&self.config, BufferLimits::of(&self.gpu));
        let mut size = TrainSize::of(self.dataset, config, limits, self.extremes.splats);
        let (all, below) = (self.extremes.counts, config.sh_degree as usize);
        size.lower = std::array::from_fn(|degree| if degree < below { all[degree] } else { 0 });
        if self.extremes.isects > 0 {
            size.isects = self.extremes.isects;
        }
        size
    }

    /// Maximum number of splats of the run, if known: see [`splats_expected`].
    pub fn splats_expected(&self) -> Option<usize> {
        let most = DeviceState::splat_limit(&self.gpu, self.config.sh_degree);
        let is_capped = self.config.strategy == StrategyKind::Mcmc || self.config.splat_limit() < most;
        is_capped
            .then(|| splats_expected(&self.config, self.splat_count()))
            .flatten()
    }

    /// Grows the buffers for a frame with these counts; pairs beyond one binding are split into depth bands. No step
    /// may be in flight.
    pub(super) fn grow_buffers(&mut self, counts: &[u32]) -> Result<()> {
        let wanted = counts[COUNT_ISECT_WANTED as usize] as usize;
        let capacity = Capacity {
            isects: with_margin(wanted),
            ..self.scratch.capacity
        };
        let capacity = capacity.within(self.gpu.caps(), record_bytes(self.config.outputs()));
        let limit = list_limit(self.gpu.caps().kind);
        let bands = self.bands.after(counts, &capacity, limit)?;
        let was_banded = self.bands.count > 1;
        self.bands = DepthBands {
            // Other views may have needed more.
            count: bands.count.max(self.bands.count),
            ..bands
        };
        if self.bands.count > 1 && !was_banded {
            self.state.keep_gradients(&self.gpu)?;
        }
        self.resize(capacity)
    }

    /// Reallocates the buffers of a step. No step may be in flight.
    pub(super) fn resize(&mut self, capacity: Capacity) -> Result<()> {
        let bytes = |capacity| total(&step_needs(capacity, self.config.outputs()));
        self.check_room(bytes(self.scratch.capacity), bytes(capacity))?;
        self.frames.release()?;
        self.remake(capacity)
    }

    fn remake(&mut self, capacity: Capacity) -> Result<()> {
        for capacity in [Capacity::LEAST, capacity] {
            self.scratch = new_scratch(&self.gpu, capacity, self.bands, self.config.outputs())?;
            self.gradients = Gradients::new(&self.gpu, self.scratch.capacity, self.config.outputs())?;
        }
        Ok(())
    }

    /// Replaces the state, possibly by one of another size; gradients that wait are dropped. If the memory limit
    /// refuses it, the run is unchanged.
    pub(super) fn take_over(&mut self, state: &HostState) -> Result<()> {
        if self.state.fits(state) {
            self.colors = ColorQueue::new(self.iteration, &[]);
            return self.state.fill(&self.gpu, state);
        }
        let capacity = self.capacity_for(state.len());
        let (filter, sh_degree) = (self.state.model.filter, state.sh_degree);
        self.check_replacement(&state.degrees, capacity, 0)?;
        self.colors = ColorQueue::new(self.iteration, &[]);
        self.frames.release()?;
        let nothing = HostState {
            primitive: state.primitive,
            ..HostState::zeros(0, sh_degree)
        };
        self.state = DeviceState::new(&self.gpu, &nothing, filter)?;
        self.state = DeviceState::new(&self.gpu, state, filter)?;
        self.make_ready(&state.degrees, capacity)
    }

    /// Replaces the splats by refined ones; harmonics and moments stay on the device. If the memory limit refuses it,
    /// the run is unchanged.
    pub(super) fn take_rows(&mut self, rows: &RefinedRows<'_>) -> Result<()> {
        let degrees = &rows.geometry.degrees;
        let capacity = self.capacity_for(degrees.len());
        // Meanwhile the buffers of a step are gone, and one group of the state's buffers exists twice.
        let old = total(&DeviceState::needs(self.state.model.blocks.room));
        let twice = total(&Model::needs(Blocks::anywhere(Slots::of(degrees).counts)));
        self.check_replacement(degrees, capacity, old + twice)?;
        self.frames.release()?;
        self.remake(Capacity::LEAST)?;
        self.state.reorder(&self.gpu, &self.select_rows, rows)?;
        self.make_ready(degrees, capacity)
    }

    /// Capacity of a step's buffers for so many splats.
    fn capacity_for(&self, count: usize) -> Capacity {
        let before = self.state.model.splat_count;
        // Pairs grow with splats: enlarge their buffers in the same reallocation.
        let growth = count.saturating_sub(before) as f64 / before.max(1) as f64;
        let isects = (self.extremes.isects as f64 * (1.0 + 0.5 * growth)) as usize;
        Capacity {
            splats: count,
            isects: self.scratch.capacity.isects.max(isects),
            ..self.scratch.capacity
        }
    }

    /// Checks that the limit allows the buffers of splats of these degrees in place of the present ones, and before
    /// them so many bytes `meanwhile`.
    fn check_replacement(&self, degrees: &[u8], capacity: Capacity, meanwhile: u64) -> Result<()> {
        let outputs = self.config.outputs();
        let bytes = |room, capacity| total(&DeviceState::needs(room)) + total(&step_needs(capacity, outputs));
        let freed = bytes(self.state.model.blocks.room, self.scratch.capacity);
        let plane = (16 * degrees.len()).min(TRANSFER_BYTES) as u64;
        let counts = Slots::of(degrees).counts;
        self.check_room(freed, bytes(counts, capacity).max(meanwhile) + plane)
    }

    /// Makes the buffers of a step for the state's splats.
    fn make_ready(&mut self, degrees: &[u8], capacity: Capacity) -> Result<()> {
        self.prepare()?;
        if self.bands.count > 1 {
            self.state.keep_gradients(&self.gpu)?;
        }
        self.extremes.note(degrees);
        self.remake(capacity)
    }

    /// Allocates gradients for steps in bands.
    pub(super) fn prepare(&mut self) -> Result<()> {
        let mut cameras = self.dataset.views.iter().map(|view| &view.camera);
        if cameras.any(|camera| self.row_bands(camera).len() > 1) {
            self.state.keep_gradients(&self.gpu)?;
        }
        Ok(())
    }

    /// Checks that the limit allows `wanted` bytes in place of `freed`.
    fn check_room(&self, freed: u64, wanted: u64) -> Result<()> {
        let taken = self.gpu.memory_in_use().saturating_sub(freed);
        let available = self.gpu.memory_limit().saturating_sub(taken);
        match wanted <= available {
            true => Ok(()),
            false => Err(Error::OutOfMemory {
                name: "training's buffers".into(),
                wanted,
                available,
            }),
        }
    }
}

/// Capacity for steps of so many splats with this camera, before the pairs of one are known.
pub(super) fn before_steps(splats: usize, camera: &Camera, outputs: Outputs, binding: u64) -> Capacity {
    let bands = row_bands([camera.width, camera.height], outputs, binding);
    let [width, height] = bands.drawn();
    Capacity::for_image(splats, with_margin(bands.pairs_expected(splats)), width, height)
}

/// Scratch with zeroed counts, for at most as many pairs at a time as one binding holds.
pub(super) fn new_scratch(gpu: &Gpu, capacity: Capacity, bands: DepthBands, outputs: Outputs) -> Result<Scratch> {
    let capacity = capacity.within(gpu.caps(), record_bytes(outputs));
    let mut scratch = Scratch::new(gpu, capacity, outputs)?;
    if bands.count > 1 {
        scratch.replay = Some(BandReplay::new(gpu, &capacity, bands)?);
    }
    gpu.run(|rec| rec.fill(&scratch.counts, 0))?;
    Ok(scratch)
}

/// Lowers the splat limit to that of the device.
pub(super) fn limit_splats(gpu: &Gpu, config: &mut TrainConfig) {
    let limit = DeviceState::splat_limit(gpu, config.sh_degree).min(config.splat_limit());
    config.max_splats = Some(u32::try_from(limit).unwrap_or(u32::MAX));
}
