//! Arena of descriptor sets, free for use again all at once.

use super::check::check;
use super::device::Gpu;
use super::pipeline::{RawPipeline, descriptor_type};
use super::slot::{Slot, SlotKind};
use crate::Result;
use ash::vk;
use std::collections::HashMap;

const SETS_PER_POOL: u32 = 128;
const BUFFERS_PER_POOL: u32 = 1024;
const IMAGES_PER_POOL: u32 = 16;

/// Bindings of a kernel at the most: storage buffers that devices must offer, and images.
pub(super) const BINDINGS_MAX: usize = 24;

/// Descriptor sets of a frame slot. Sets are made on demand and written anew in every frame, so that warm frames
/// allocate none.
pub(super) struct Arena {
    gpu: Gpu,
    pools: Vec<vk::DescriptorPool>,
    /// Index of the pool in use.
    current: usize,
    /// Sets of each pipeline, which the device keeps.
    sets: HashMap<vk::Pipeline, Sets>,
}

/// Sets with one pipeline's layout.
#[derive(Default)]
struct Sets {
    sets: Vec<vk::DescriptorSet>,
    /// Sets in use by the frame.
    used: usize,
}

impl Arena {
    pub(super) fn new(gpu: &Gpu) -> Arena {
        Arena {
            gpu: gpu.clone(),
            pools: Vec::new(),
            current: 0,
            sets: HashMap::new(),
        }
    }

    /// Frees all sets for the next frame; none may be in use.
    pub(super) fn reset(&mut self) {
        self.sets.values_mut().for_each(|sets| sets.used = 0);
    }

    fn grow(&mut self) -> Result<()> {
        let sizes = [
            vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count(BUFFERS_PER_POOL),
            vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::STORAGE_IMAGE)
                .descriptor_count(IMAGES_PER_POOL),
            vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::SAMPLED_IMAGE)
                .descriptor_count(IMAGES_PER_POOL),
        ];
        let info = vk::DescriptorPoolCreateInfo::default()
            .max_sets(SETS_PER_POOL)
            .pool_sizes(&sizes);
        self.gpu.0.creating("vkCreateDescriptorPool")?;
        // SAFETY: a plain pool.
        let pool = unsafe { self.gpu.0.device.create_descriptor_pool(&info, None) };
        self.pools.push(check("vkCreateDescriptorPool", pool)?);
        Ok(())
    }

    fn allocate(&mut self, layout: vk::DescriptorSetLayout) -> Result<vk::DescriptorSet> {
        self.gpu.0.creating("vkAllocateDescriptorSets")?;
        let layouts = [layout];
        loop {
            if self.current == self.pools.len() {
                self.grow()?;
            }
            let info = vk::DescriptorSetAllocateInfo::default()
                .descriptor_pool(self.pools[self.current])
                .set_layouts(&layouts);
            // SAFETY: pool and layout are alive.
            match unsafe { self.gpu.0.device.allocate_descriptor_sets(&info) } {
                Ok(sets) => return Ok(sets[0]),
                Err(vk::Result::ERROR_OUT_OF_POOL_MEMORY | vk::Result::ERROR_FRAGMENTED_POOL) => {
                    self.current += 1;
                }
                Err(code) => return check("vkAllocateDescriptorSets", Err(code)),
            }
        }
    }

    /// Set of one dispatch, bound to `slots`.
    pub(super) fn set(&mut self, pipeline: &RawPipeline, slots: &[Slot<'_>]) -> Result<vk::DescriptorSet> {
        let id = pipeline.kernel.pipeline;
        let known = self.sets.get(&id).and_then(|sets| sets.sets.get(sets.used)).copied();
        let set = match known {
            Some(set) => set,
            None => self.allocate(pipeline.kernel.set_layout)?,
        };
        let sets = self.sets.entry(id).or_default();
        if known.is_none() {
            sets.sets.push(set);
        }
        sets.used += 1;
        self.write(set, pipeline, slots);
        Ok(set)
    }

    fn write(&self, set: vk::DescriptorSet, pipeline: &RawPipeline, slots: &[Slot<'_>]) {
        let mut buffers = [vk::DescriptorBufferInfo::default(); BINDINGS_MAX];
        let mut images = [vk::DescriptorImageInfo::default(); BINDINGS_MAX];
        for (i, slot) in slots.iter().enumerate() {
            match slot.kind {
                SlotKind::Buffer { raw, offset, bytes } => {
                    buffers[i] = vk::DescriptorBufferInfo::default()
                        .buffer(raw.handle)
                        .offset(offset)
                        .range(bytes);
                }
                SlotKind::Image(image) => {
                    images[i] = vk::DescriptorImageInfo::default()
                        .image_view(image.view)
                        .image_layout(image.layout);
                }
            }
        }
        let mut writes = [vk::WriteDescriptorSet::default(); BINDINGS_MAX];
        for (i, binding) in pipeline.info.bindings.iter().enumerate() {
            let write = vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(binding.binding)
                .descriptor_type(descriptor_type(binding.kind));
            writes[i] = match slots[i].kind {
                SlotKind::Buffer { .. } => write.buffer_info(std::slice::from_ref(&buffers[i])),
                SlotKind::Image(_) => write.image_info(std::slice::from_ref(&images[i])),
            };
        }
        let writes = &writes[..pipeline.info.bindings.len()];
        // SAFETY: no command that runs uses the set, and the infos outlive the call.
        unsafe { self.gpu.0.device.update_descriptor_sets(writes, &[]) };
    }
}

impl Drop for Arena {
    fn drop(&mut self) {
        for &pool in &self.pools {
            // SAFETY: the frame that used its sets has finished.
            unsafe { self.gpu.0.device.destroy_descriptor_pool(pool, None) };
        }
    }
}
