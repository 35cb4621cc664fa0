//! New order of the splats on the device after a refinement: harmonics and moments do not pass through the host.

use super::device::{DeviceState, GradientBuffers, MomentBuffers, blocks_of};
use super::state::{HostState, SH_PLANE};
use super::strategy::RowOrigin;
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::kernels::select_rows::{Bindings, Params, SelectRows};
use crate::layout::ORIGIN_IS_NEW;
use crate::render::{Allocate, Block, Model, Slots, plane_count};

/// Refined splats.
pub(super) struct RefinedRows<'a> {
    /// Parameters of geometry.
    pub(super) geometry: &'a HostState,
    /// Row so far of the harmonics and moments of each splat.
    pub(super) origins: &'a [RowOrigin],
    /// Whether the moments of all opacities become 0.
    pub(super) resets_opacity: bool,
}

/// Block of refined splats.
struct Destination {
    block: Block,
    /// Earlier slot of each slot, with [`ORIGIN_IS_NEW`].
    origin_from_slot: Buffer<u32>,
    /// Earlier blocks with such slots.
    sources: Vec<Block>,
}

/// New order of the slots.
struct Reordering<'a> {
    gpu: &'a Gpu,
    kernel: &'a SelectRows,
    destinations: Vec<Destination>,
}

/// Numbers to select of each splat.
#[derive(Clone, Copy)]
struct Selection {
    plane_first: usize,
    moments: bool,
    resets_opacity: bool,
}

impl DeviceState {
    /// Replaces the splats by refined ones, in buffers without spare capacity: one group of buffers at a time, so that
    /// at most one exists twice. Statistics start at 0, and gradients are lost.
    pub(super) fn reorder(&mut self, gpu: &Gpu, kernel: &SelectRows, rows: &RefinedRows<'_>) -> Result<()> {
        let slots = Slots::of(&rows.geometry.degrees);
        let blocks = blocks_of(gpu, &slots, self.sh_degree);
        let reordering = Reordering {
            gpu,
            kernel,
            destinations: self.destinations(gpu, rows, blocks.of(slots.counts), &slots)?,
        };
        self.buffers = GradientBuffers::new(gpu, blocks_of(gpu, &Slots::of(&[]), self.sh_degree))?;
        let parameters = Selection {
            plane_first: SH_PLANE,
            moments: false,
            resets_opacity: false,
        };
        let moments = Selection {
            plane_first: 0,
            moments: true,
            resets_opacity: rows.resets_opacity,
        };
        let model = Model {
            primitive: self.model.primitive,
            ..Model::empty(gpu, blocks, self.sh_degree, self.model.filter)?
        };
        reordering.select(&self.model.params, &model.params, parameters)?;
        self.model = model;
        let MomentBuffers { moment1, moment2 } = &mut self.moments;
        for (name, buffers) in [("moment1", moment1), ("moment2", moment2)] {
            let refined: Vec<Buffer<[f32; 4]>> = Allocate::allocate(gpu, name, blocks.sizes())?;
            reordering.select(buffers, &refined, moments)?;
            *buffers = refined;
        }
        self.buffers = GradientBuffers::new(gpu, blocks)?;
        self.fill(gpu, rows.geometry)
    }

    fn destinations(
        &self,
        gpu: &Gpu,
        rows: &RefinedRows<'_>,
        blocks: impl Iterator<Item = Block>,
        slots: &Slots,
    ) -> Result<Vec<Destination>> {
        let mut slot_from_splat = vec![0; self.model.splat_count];
        for slot in 0..self.model.splat_count {
            slot_from_splat[self.slots.splat(slot)] = slot as u32;
        }
        let origin = |splat: &u32| {
            let RowOrigin { row, is_new } = rows.origins[*splat as usize];
            slot_from_splat[row as usize] | if is_new { ORIGIN_IS_NEW } else { 0 }
        };
        let destination = |block: Block| {
            let origins: Vec<u32> = slots.of_slots(block.slots()).iter().map(origin).collect();
            let places = || origins.iter().map(|origin| (origin & !ORIGIN_IS_NEW) as usize);
            let (first, last) = (places().min().unwrap_or(0), places().max().unwrap_or(0));
            let sources = self.model.blocks.of(self.slots.counts);
            let holds = |source: &Block| source.first <= last && source.slots().end > first;
            Ok(Destination {
                block,
                origin_from_slot: gpu.buffer_from("origin_from_slot", &origins)?,
                sources: sources.filter(holds).collect(),
            })
        };
        blocks.map(destination).collect()
    }
}

impl Reordering<'_> {
    /// Fills the buffers of a group from those so far, and waits.
    fn select(&self, from: &[Buffer<[f32; 4]>], to: &[Buffer<[f32; 4]>], selection: Selection) -> Result<()> {
        self.gpu.run(|rec| {
            for destination in &self.destinations {
                let block = destination.block;
                for source in &destination.sources {
                    let io = Bindings {
                        origin_from_slot: &destination.origin_from_slot,
                        before: &from[source.index],
                        after: &to[block.index],
                    };
                    let params = Params {
                        slot_count: block.count as u32,
                        stride: block.stride as u32,
                        source_first: source.first as u32,
                        source_count: source.count as u32,
                        source_stride: source.stride as u32,
                        plane_first: selection.plane_first as u32,
                        plane_count: plane_count(block.degree) as u32,
                        moments: selection.moments.into(),
                        fade: selection.resets_opacity.into(),
                    };
                    self.kernel.record(rec, io, params, self.kernel.groups(block.count));
                }
            }
        })
    }
}
