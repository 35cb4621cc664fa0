//! Upload of a scene by recorded commands, whole or in parts.

use super::blocks::Block;
use super::model::Model;
use super::precision::Precision;
use super::slots::Slots;
use crate::Result;
use crate::gpu::{Gpu, Recorder};
use crate::scene::Splats;

/// Scene on the way to a device, a part at a time.
pub struct ModelUpload<'a> {
    splats: &'a Splats,
    slots: Slots,
    precision: Precision,
    model: Model,
    /// Blocks that no part has begun, last first.
    blocks: Vec<Block>,
    current: BlockUpload,
}

/// Block on the way.
#[derive(Default)]
struct BlockUpload {
    /// Index of the block.
    index: usize,
    planes: Vec<[f32; 4]>,
    splat_from_slot: Vec<u32>,
    /// Elements of either that are recorded.
    planes_done: usize,
    slots_done: usize,
}

impl std::fmt::Debug for ModelUpload<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ModelUpload({:?}, {} blocks left)", self.model, self.blocks.len())
    }
}

impl<'a> ModelUpload<'a> {
    /// Allocates the model's buffers.
    pub(super) fn new(gpu: &Gpu, splats: &'a Splats, precision: Precision) -> Result<ModelUpload<'a>> {
        let slots = Slots::of_scene(splats);
        let model = Model::reserve(gpu, splats, &slots, precision)?;
        let mut blocks: Vec<Block> = model.blocks.of(model.counts).collect();
        blocks.reverse();
        Ok(ModelUpload {
            splats,
            slots,
            precision,
            model,
            blocks,
            current: BlockUpload::default(),
        })
    }

    /// Records up to `bytes` of what is left, a vec4 at least. True once everything is recorded.
    pub(super) fn record(&mut self, rec: &mut Recorder<'_>, mut bytes: usize) -> bool {
        loop {
            let moved = self.current.record(&self.model, rec, bytes.max(size_of::<[f32; 4]>()));
            bytes = bytes.saturating_sub(moved);
            if !self.current.is_done() {
                return false;
            }
            let Some(block) = self.blocks.pop() else {
                return true;
            };
            self.current = self.begin(&block);
            if bytes == 0 {
                return false;
            }
        }
    }

    /// The model, whose buffers are complete once all parts have run.
    pub(super) fn model(&self) -> &Model {
        &self.model
    }

    fn begin(&self, block: &Block) -> BlockUpload {
        let splat_from_slot = self.slots.of_slots(block.slots());
        BlockUpload {
            index: block.index,
            planes: self.precision.planes_of(self.splats, &splat_from_slot, block.degree),
            splat_from_slot: match self.model.is_indexed() {
                true => splat_from_slot,
                false => Vec::new(),
            },
            ..BlockUpload::default()
        }
    }
}

impl BlockUpload {
    fn is_done(&self) -> bool {
        self.planes_done == self.planes.len() && self.slots_done == self.splat_from_slot.len()
    }

    /// Records up to `bytes`, and returns their number.
    fn record(&mut self, model: &Model, rec: &mut Recorder<'_>, bytes: usize) -> usize {
        let planes = (bytes / size_of::<[f32; 4]>()).min(self.planes.len() - self.planes_done);
        if planes > 0 {
            let range = self.planes_done..self.planes_done + planes;
            rec.update(&model.params[self.index], range.start, &self.planes[range.clone()]);
            self.planes_done = range.end;
        }
        let left = bytes - planes * size_of::<[f32; 4]>();
        let slots = (left / size_of::<u32>()).min(self.splat_from_slot.len() - self.slots_done);
        if slots > 0 {
            let range = self.slots_done..self.slots_done + slots;
            let index = &model.splat_from_slot[self.index];
            rec.update(index, range.start, &self.splat_from_slot[range.clone()]);
            self.slots_done = range.end;
        }
        planes * size_of::<[f32; 4]>() + slots * size_of::<u32>()
    }
}
