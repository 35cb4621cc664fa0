//! Arena of descriptor sets, freed all at once.

use super::check::check;
use super::device::Gpu;
use super::pipeline::{RawPipeline, descriptor_type};
use super::slot::{Slot, SlotKind};
use crate::Result;
use ash::vk;

const SETS_PER_POOL: u32 = 128;
const BUFFERS_PER_POOL: u32 = 1024;
const IMAGES_PER_POOL: u32 = 16;

/// Descriptor pools of a frame slot: added on demand, reset when the slot is reused.
pub(super) struct Arena {
    gpu: Gpu,
    pools: Vec<vk::DescriptorPool>,
    /// Index of the pool in use.
    current: usize,
}

impl Arena {
    pub(super) fn new(gpu: &Gpu) -> Arena {
        Arena {
            gpu: gpu.clone(),
            pools: Vec::new(),
            current: 0,
        }
    }

    /// Frees all sets; none may be in use.
    pub(super) fn reset(&mut self) -> Result<()> {
        for &pool in &self.pools {
            let flags = vk::DescriptorPoolResetFlags::empty();
            // SAFETY: the frame that used the sets has finished.
            let reset = unsafe { self.gpu.0.device.reset_descriptor_pool(pool, flags) };
            check("vkResetDescriptorPool", reset)?;
        }
        self.current = 0;
        Ok(())
    }

    fn grow(&mut self) -> Result<()> {
        let sizes = [
            vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count(BUFFERS_PER_POOL),
            vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::STORAGE_IMAGE)
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

    /// New set of one dispatch, bound to `slots`.
    pub(super) fn set(&mut self, pipeline: &RawPipeline, slots: &[Slot<'_>]) -> Result<vk::DescriptorSet> {
        let set = self.allocate(pipeline.set_layout)?;
        let mut buffers = vec![vk::DescriptorBufferInfo::default(); slots.len()];
        let mut images = vec![vk::DescriptorImageInfo::default(); slots.len()];
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
                        .image_layout(vk::ImageLayout::GENERAL);
                }
            }
        }
        let writes: Vec<_> = pipeline
            .info
            .bindings
            .iter()
            .enumerate()
            .map(|(i, binding)| {
                let write = vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(binding.binding)
                    .descriptor_type(descriptor_type(binding.kind));
                match slots[i].kind {
                    SlotKind::Buffer { .. } => write.buffer_info(std::slice::from_ref(&buffers[i])),
                    SlotKind::Image(_) => write.image_info(std::slice::from_ref(&images[i])),
                }
            })
            .collect();
        // SAFETY: the set is new, and the infos outlive the call.
        unsafe { self.gpu.0.device.update_descriptor_sets(&writes, &[]) };
        Ok(set)
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
