//! Command recording with automatic barriers; the only way to record commands.
//!
//! Every command declares its reads and writes; a barrier is recorded before a command that conflicts with an access
//! since the last barrier. Used resources are kept alive until the frame's slot is reused.

use super::buffer::{Buffer, RawBuffer};
use super::descriptors::BINDINGS_MAX;
use super::device::Gpu;
use super::frame_slot::FrameSlot;
use super::hazards::Reach;
use super::image::{Image, ImageState, whole};
use super::pipeline::{Pipeline, RawPipeline};
use super::slot::{Groups, Slot, SlotKind};
use crate::Result;
use crate::shader::Access;
use ash::vk;
use ash::vk::Handle;
use bytemuck::Pod;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

/// Pending copy of a range of a buffer to the host.
#[derive(Clone)]
pub struct Readback<T> {
    raw: Arc<RawBuffer>,
    offset: usize,
    len: usize,
    element: PhantomData<fn() -> T>,
}

impl<T: Pod> Readback<T> {
    /// The elements. The frame that recorded the copy must be done: wait for its ticket first.
    pub fn get(&self) -> Vec<T> {
        self.elements().to_vec()
    }

    /// As [`Readback::get`], without a copy.
    pub fn elements(&self) -> &[T] {
        let bytes = &self.raw.mapped()[self.offset..self.offset + self.len * size_of::<T>()];
        bytemuck::cast_slice(bytes)
    }
}

/// Records the commands of one frame.
pub struct Recorder<'a> {
    pub(super) gpu: Gpu,
    pub(super) commands: vk::CommandBuffer,
    pub(super) slot: &'a mut FrameSlot,
    /// The first error. Later commands are left out, as they would read its missing results; barriers and transitions
    /// are recorded, and submission or `finish` reports it.
    pub(super) failed: Option<crate::Error>,
}

/// Stages and accesses of one side of a barrier.
type BarrierScope = (vk::PipelineStageFlags2, vk::AccessFlags2);

/// Stages of this crate's commands.
const STAGES: vk::PipelineStageFlags2 = vk::PipelineStageFlags2::from_raw(
    vk::PipelineStageFlags2::COMPUTE_SHADER.as_raw()
        | vk::PipelineStageFlags2::ALL_TRANSFER.as_raw()
        | vk::PipelineStageFlags2::DRAW_INDIRECT.as_raw(),
);
/// Writes of this crate's commands.
const WRITES: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
    vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw() | vk::AccessFlags2::TRANSFER_WRITE.as_raw(),
);
/// Stage and accesses of shaders.
const SHADERS: BarrierScope = (
    vk::PipelineStageFlags2::COMPUTE_SHADER,
    vk::AccessFlags2::from_raw(
        vk::AccessFlags2::SHADER_STORAGE_READ.as_raw()
            | vk::AccessFlags2::SHADER_SAMPLED_READ.as_raw()
            | vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw(),
    ),
);
/// Reads of this crate's commands.
const READS: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
    vk::AccessFlags2::SHADER_STORAGE_READ.as_raw()
        | vk::AccessFlags2::SHADER_SAMPLED_READ.as_raw()
        | vk::AccessFlags2::TRANSFER_READ.as_raw()
        | vk::AccessFlags2::INDIRECT_COMMAND_READ.as_raw(),
);

impl<'a> Recorder<'a> {
    /// Device of the commands.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    pub(super) fn device(&self) -> &ash::Device {
        &self.gpu.0.device
    }

    /// Memory barrier between earlier and later commands of this crate: of other commands before it and after it in the
    /// queue, only those of the same stages are ordered.
    pub(super) fn barrier(&mut self) {
        self.order(Reach::All);
        self.slot.hazards.barrier();
    }

    fn order(&self, reach: Reach) {
        let after = match reach {
            Reach::Shaders => SHADERS,
            Reach::All => (STAGES, WRITES | READS),
        };
        self.memory_barrier((STAGES, WRITES), after);
    }

    /// Memory barrier that makes copies visible to the host.
    pub(super) fn host_barrier(&mut self) {
        use vk::{AccessFlags2 as Access, PipelineStageFlags2 as Stage};
        self.memory_barrier((Stage::COPY, Access::TRANSFER_WRITE), (Stage::HOST, Access::HOST_READ));
    }

    fn memory_barrier(&self, from: BarrierScope, to: BarrierScope) {
        let barriers = [vk::MemoryBarrier2::default()
            .src_stage_mask(from.0)
            .src_access_mask(from.1)
            .dst_stage_mask(to.0)
            .dst_access_mask(to.1)];
        let info = vk::DependencyInfo::default().memory_barriers(&barriers);
        // SAFETY: the command buffer is being recorded.
        unsafe { self.device().cmd_pipeline_barrier2(self.commands, &info) };
    }

    /// Orders a transfer behind earlier commands.
    pub(super) fn access(&mut self, accesses: &[(u64, Access)]) {
        self.order_accesses(&[], accesses);
    }

    fn order_accesses(&mut self, shader: &[(u64, Access)], other: &[(u64, Access)]) {
        if let Some(reach) = self.slot.hazards.command(shader, other) {
            self.order(reach);
        }
    }

    /// Dispatches a kernel with `slots` in the order of its bindings. Called by generated code.
    pub fn dispatch(&mut self, pipeline: &Pipeline, slots: &[Slot<'_>], push: &[u8], groups: Groups<'_>) {
        let raw: &RawPipeline = &pipeline.0;
        assert_eq!(
            slots.len(),
            raw.info.bindings.len(),
            "{}: one slot per binding",
            raw.info.kernel
        );
        if self.failed.is_some() {
            return;
        }
        let mut accesses = [(0, Access::Read); BINDINGS_MAX];
        for (i, (slot, binding)) in slots.iter().zip(raw.info.bindings).enumerate() {
            accesses[i] = (slot.id(), binding.access);
        }
        let arguments = match groups {
            Groups::Indirect(args, _) => Some((args.id(), Access::Read)),
            _ => None,
        };
        self.order_accesses(&accesses[..slots.len()], arguments.as_slice());
        let set = match self.slot.arena.set(raw, slots) {
            Ok(set) => set,
            Err(error) => return self.fail(error),
        };
        for slot in slots {
            match slot.kind {
                SlotKind::Buffer { raw, .. } => self.slot.keep(raw.clone()),
                SlotKind::Image(image) => image.own.iter().for_each(|own| self.slot.keep(own.clone())),
            }
        }
        let device = &self.gpu.0.device;
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: pipeline, layout and set are alive until the frame is done, and belong together.
        unsafe {
            device.cmd_bind_pipeline(self.commands, point, raw.kernel.pipeline);
            device.cmd_bind_descriptor_sets(self.commands, point, raw.kernel.layout, 0, &[set], &[]);
        }
        if !push.is_empty() {
            let stage = vk::ShaderStageFlags::COMPUTE;
            // SAFETY: the layout has a range of this size (generated from the same reflection).
            unsafe { device.cmd_push_constants(self.commands, raw.kernel.layout, stage, 0, push) };
        }
        self.gpu.0.names.begin(self.commands, &raw.label);
        self.dispatch_groups(groups);
        self.gpu.0.names.end(self.commands);
    }

    fn dispatch_groups(&mut self, groups: Groups<'_>) {
        let limit = self.gpu.caps().max_groups;
        let [x, y, z] = match groups {
            Groups::Indirect(args, index) => {
                let SlotKind::Buffer { raw, offset, .. } = args.kind else {
                    return;
                };
                self.slot.keep(raw.clone());
                // SAFETY: the element lies in the buffer (asserted in `Groups::indirect`), which has the indirect
                // usage; the kernel that wrote it kept to the device's limits.
                unsafe {
                    self.device()
                        .cmd_dispatch_indirect(self.commands, raw.handle, offset + 12 * index as u64);
                }
                return;
            }
            Groups::Count(0) => return,
            Groups::Count(count) => {
                let x = count.min(limit[0]);
                [x, count.div_ceil(x), 1]
            }
            Groups::Grid(grid) => grid,
        };
        assert!(
            x <= limit[0] && y <= limit[1] && z <= limit[2],
            "a grid of {x}x{y}x{z} workgroups is too large"
        );
        // SAFETY: within the device's limits.
        unsafe { self.device().cmd_dispatch(self.commands, x, y, z) };
    }

    /// Sets every word of a buffer.
    pub fn fill<T: Pod>(&mut self, buffer: &Buffer<T>, word: u32) {
        if buffer.is_empty() || self.failed.is_some() {
            return;
        }
        let bytes = buffer.reach();
        self.access(&[(buffer.raw.handle.as_raw(), Access::Write)]);
        self.slot.keep(buffer.raw.clone());
        // SAFETY: the buffer is alive until the frame is done and its size is a multiple of four.
        unsafe {
            self.device()
                .cmd_fill_buffer(self.commands, buffer.raw.handle, buffer.offset, bytes, word);
        }
    }

    /// Copies `range` of `from` to `to`, from element `at` on.
    pub fn copy<T: Pod>(&mut self, from: &Buffer<T>, range: Range<usize>, to: &Buffer<T>, at: usize) {
        assert!(
            range.end <= from.len() && at + range.len() <= to.len(),
            "copy out of bounds: {from:?} to {to:?}"
        );
        let size = size_of::<T>();
        self.copy_raw(
            &from.raw,
            from.offset as usize + range.start * size,
            &to.raw,
            to.offset as usize + at * size,
            range.len() * size,
        );
    }

    fn copy_raw(&mut self, from: &Arc<RawBuffer>, start: usize, to: &Arc<RawBuffer>, at: usize, bytes: usize) {
        if bytes == 0 || self.failed.is_some() {
            return;
        }
        self.access(&[
            (from.handle.as_raw(), Access::Read),
            (to.handle.as_raw(), Access::Write),
        ]);
        self.slot.keep(from.clone());
        self.slot.keep(to.clone());
        let regions = [vk::BufferCopy::default()
            .src_offset(start as u64)
            .dst_offset(at as u64)
            .size(bytes as u64)];
        // SAFETY: in bounds (asserted by the callers), and both are alive until the frame is done.
        unsafe {
            self.device()
                .cmd_copy_buffer(self.commands, from.handle, to.handle, &regions)
        };
    }

    /// Writes `data` into a buffer from element `at` on, when the frame runs. The data is copied at once.
    pub fn update<T: Pod>(&mut self, buffer: &Buffer<T>, at: usize, data: &[T]) {
        assert!(at + data.len() <= buffer.len(), "update out of bounds: {buffer:?}");
        let bytes: &[u8] = bytemuck::cast_slice(data);
        match self.slot.staging.take(&self.gpu, bytes.len()) {
            Ok((raw, offset)) => {
                raw.write(offset, bytes);
                let to = buffer.offset as usize + at * size_of::<T>();
                self.copy_raw(&raw, offset, &buffer.raw, to, bytes.len());
            }
            Err(error) => self.fail(error),
        }
    }

    /// Copies a range of a buffer to host-visible memory, readable once the frame is done.
    pub fn read_back<T: Pod>(&mut self, buffer: &Buffer<T>, range: Range<usize>) -> Result<Readback<T>> {
        assert!(range.end <= buffer.len(), "read_back out of bounds: {buffer:?}");
        let bytes = range.len() * size_of::<T>();
        let (raw, offset) = self.slot.reading.take(&self.gpu, bytes)?;
        self.copy_raw(
            &buffer.raw,
            buffer.offset as usize + range.start * size_of::<T>(),
            &raw,
            offset,
            bytes,
        );
        Ok(Readback {
            raw,
            offset,
            len: range.len(),
            element: PhantomData,
        })
    }

    /// As [`Recorder::read_back`], of `rows` ranges of the length `len`, the first from element `from` on, each
    /// `stride` elements behind the one before.
    pub fn read_back_rows<T: Pod>(
        &mut self,
        buffer: &Buffer<T>,
        from: usize,
        (len, stride, rows): (usize, usize, usize),
    ) -> Result<Readback<T>> {
        assert!(len > 0 && rows > 0 && len <= stride, "no rows");
        let last = from + (rows - 1) * stride + len;
        assert!(last <= buffer.len(), "read_back out of bounds: {buffer:?}");
        let size = size_of::<T>();
        let (raw, offset) = self.slot.reading.take(&self.gpu, rows * len * size)?;
        self.access(&[
            (buffer.raw.handle.as_raw(), Access::Read),
            (raw.handle.as_raw(), Access::Write),
        ]);
        self.slot.keep(buffer.raw.clone());
        self.slot.keep(raw.clone());
        let region = |row: usize| {
            vk::BufferCopy::default()
                .src_offset(buffer.offset + ((from + row * stride) * size) as u64)
                .dst_offset((offset + row * len * size) as u64)
                .size((len * size) as u64)
        };
        let regions: Vec<vk::BufferCopy> = (0..rows).map(region).collect();
        // SAFETY: in bounds (asserted), and both are alive until the frame is done.
        unsafe {
            self.device()
                .cmd_copy_buffer(self.commands, buffer.raw.handle, raw.handle, &regions)
        };
        Ok(Readback {
            raw,
            offset,
            len: rows * len,
            element: PhantomData,
        })
    }

    /// Timestamp that attributes the time since the previous one to `label`. No effect in frames made without
    /// timestamps.
    pub fn timestamp(&mut self, label: &'static str) {
        if let Some(timestamps) = &mut self.slot.timestamps {
            timestamps.mark(self.commands, label);
        }
    }

    /// Image barrier that orders the accesses of `from` before those of `to` and changes the layout.
    pub(super) fn transition(&mut self, image: &Image, from: ImageState, to: ImageState) {
        transition(&self.gpu, self.commands, image, from, to);
    }

    pub(super) fn fail(&mut self, error: crate::Error) {
        self.failed.get_or_insert(error);
    }
}

/// As [`Recorder::transition`].
pub(super) fn transition(gpu: &Gpu, commands: vk::CommandBuffer, image: &Image, from: ImageState, to: ImageState) {
    let barriers = [vk::ImageMemoryBarrier2::default()
        .src_stage_mask(from.stage)
        .src_access_mask(from.access)
        .dst_stage_mask(to.stage)
        .dst_access_mask(to.access)
        .old_layout(from.layout)
        .new_layout(to.layout)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .image(image.image)
        .subresource_range(whole(image.aspects, image.layer))];
    let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
    // SAFETY: a host's image is in the state that its wrapper's contract says, an owned one in the state that the last
    // transition left.
    unsafe { gpu.0.device.cmd_pipeline_barrier2(commands, &info) };
}
