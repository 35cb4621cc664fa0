//! Ring of frames in flight on one timeline.

use super::check::check;
use super::device::Gpu;
use super::frame_slot::{FrameSlot, STAGING_BYTES};
use super::host::HostCommands;
use super::recorder::Recorder;
use super::timing::Timestamps;
use crate::Result;
use ash::vk;
use std::sync::Arc;

/// Identifier of a submission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(u64);

/// A ring of frames in flight: on a timeline of its own, or in a host's commands.
pub struct Frames {
    gpu: Gpu,
    /// Null for frames in a host's commands.
    timeline: vk::Semaphore,
    slots: Vec<FrameSlot>,
    /// Number of frames begun; the next one takes slot `begun % slots.len()`.
    begun: u64,
    submitted: u64,
    /// Identity of the ring in a host's commands; `None` if frames are submitted here.
    guest: Option<Arc<()>>,
}

impl Frames {
    /// Ring of `in_flight` frames; [`Recorder::timestamp`] has an effect only with `timestamps`.
    pub fn new(gpu: &Gpu, in_flight: usize, timestamps: bool) -> Result<Frames> {
        assert!(in_flight > 0, "at least one frame in flight");
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        gpu.0.creating("vkCreateSemaphore")?;
        // SAFETY: timeline semaphores are a required feature.
        let timeline = check("vkCreateSemaphore", unsafe {
            gpu.0.device.create_semaphore(&info, None)
        })?;
        let mut frames = Frames {
            gpu: gpu.clone(),
            timeline,
            slots: Vec::new(),
            begun: 0,
            submitted: 0,
            guest: None,
        };
        let timestamps = timestamps && gpu.caps().timestamp_period_ns > 0.0;
        for _ in 0..in_flight {
            frames.add_slot(timestamps)?;
        }
        Ok(frames)
    }

    /// Ring of `in_flight` frames in a host's commands, without Vulkan objects until something is recorded, but for
    /// those of `timestamps`.
    pub fn in_host(gpu: &Gpu, in_flight: usize, timestamps: bool) -> Result<Frames> {
        assert!(in_flight > 0, "at least one frame in flight");
        let timestamps = timestamps && gpu.caps().timestamp_period_ns > 0.0;
        let slot = |_| {
            Ok(FrameSlot {
                timestamps: timestamps.then(|| Timestamps::new(gpu)).transpose()?,
                ..FrameSlot::new(gpu)
            })
        };
        Ok(Frames {
            gpu: gpu.clone(),
            timeline: vk::Semaphore::null(),
            slots: (0..in_flight).map(slot).collect::<Result<_>>()?,
            begun: 0,
            submitted: 0,
            guest: Some(Arc::new(())),
        })
    }

    fn add_slot(&mut self, timestamps: bool) -> Result<()> {
        let device = &self.gpu.0.device;
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(self.gpu.0.family);
        self.gpu.0.creating("vkCreateCommandPool")?;
        // SAFETY: the device's own queue family.
        let pool = check("vkCreateCommandPool", unsafe {
            device.create_command_pool(&info, None)
        })?;
        self.slots.push(FrameSlot {
            pool,
            ..FrameSlot::new(&self.gpu)
        });
        let slot = self.slots.last_mut();
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .command_buffer_count(1);
        self.gpu.0.creating("vkAllocateCommandBuffers")?;
        // SAFETY: the pool was just made.
        let buffers = check("vkAllocateCommandBuffers", unsafe {
            device.allocate_command_buffers(&info)
        })?;
        if let Some(slot) = slot {
            slot.commands = buffers[0];
            slot.timestamps = timestamps.then(|| Timestamps::new(&self.gpu)).transpose()?;
        }
        Ok(())
    }

    fn index(&self, frame: u64) -> usize {
        (frame % self.slots.len() as u64) as usize
    }

    /// Starts a frame, after waiting for its slot's previous one.
    pub fn begin(&mut self) -> Result<Recorder<'_>> {
        assert!(self.guest.is_none(), "these frames are recorded into a host's commands");
        let index = self.index(self.begun);
        self.begun += 1;
        self.wait(Ticket(self.slots[index].value))?;
        let gpu = self.gpu.clone();
        let slot = &mut self.slots[index];
        // Photographs are staged again and again.
        slot.reset(u64::MAX);
        let device = &gpu.0.device;
        let flags = vk::CommandPoolResetFlags::empty();
        // SAFETY: the slot's last submission is done.
        check("vkResetCommandPool", unsafe {
            device.reset_command_pool(slot.pool, flags)
        })?;
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the pool was just reset.
        check("vkBeginCommandBuffer", unsafe {
            device.begin_command_buffer(slot.commands, &info)
        })?;
        let commands = slot.commands;
        if let Some(timestamps) = &mut slot.timestamps {
            timestamps.begin(commands);
        }
        let mut recorder = Recorder {
            gpu,
            commands,
            slot,
            failed: None,
        };
        // Validation and `Hazards` track one command buffer at a time: order it after all earlier ones.
        recorder.barrier();
        Ok(recorder)
    }

    /// Records into a host's command buffer: begins a frame, or continues the one begun there. The slot's previous
    /// frame must be done, as the contract of [`HostCommands::wrap`] says. For rings of [`Frames::in_host`].
    pub fn begin_in(&mut self, host: &mut HostCommands) -> Result<Recorder<'_>> {
        let frame = self.frame_in(host);
        let index = self.index(frame);
        let is_new = frame == self.begun;
        if is_new {
            host.begin(self.ring(), frame);
            self.begun += 1;
            // An upload of a host's happens once.
            self.slots[index].reset(STAGING_BYTES as u64);
        }
        let slot = &mut self.slots[index];
        match &mut slot.timestamps {
            Some(timestamps) if is_new => timestamps.begin(host.commands()),
            Some(timestamps) => timestamps.mark(host.commands(), "between"),
            None => {}
        }
        let mut recorder = Recorder {
            gpu: self.gpu.clone(),
            commands: host.commands(),
            slot,
            failed: None,
        };
        recorder.barrier();
        Ok(recorder)
    }

    fn ring(&self) -> &Arc<()> {
        match &self.guest {
            Some(ring) => ring,
            None => panic!("these frames are submitted here, not by a host"),
        }
    }

    /// Number of the frame that [`Frames::begin_in`] would record.
    pub fn frame_in(&self, host: &HostCommands) -> u64 {
        host.begun_by(self.ring()).unwrap_or(self.begun)
    }

    /// Frames that may be in flight.
    pub fn in_flight(&self) -> usize {
        self.slots.len()
    }

    /// Records one frame with `record` and submits it; does not wait.
    ///
    /// # Errors
    /// Those of `begin`, `record` and the submission.
    pub fn submit<R>(&mut self, record: impl FnOnce(&mut Recorder<'_>) -> Result<R>) -> Result<(Ticket, R)> {
        let mut recorder = self.begin()?;
        let result = record(&mut recorder);
        recorder.host_barrier();
        let (commands, failed) = (recorder.commands, recorder.failed.take());
        self.end(commands)?;
        let result = result?;
        failed.map_or(Ok(()), Err)?;
        Ok((self.queue(commands)?, result))
    }

    fn end(&self, commands: vk::CommandBuffer) -> Result<()> {
        // SAFETY: recording began in `begin`.
        check("vkEndCommandBuffer", unsafe {
            self.gpu.0.device.end_command_buffer(commands)
        })
    }

    fn queue(&mut self, commands: vk::CommandBuffer) -> Result<Ticket> {
        let value = self.submitted + 1;
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
        let signals = [vk::SemaphoreSubmitInfo::default()
            .semaphore(self.timeline)
            .value(value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        let submits = [vk::SubmitInfo2::default()
            .command_buffer_infos(&buffers)
            .signal_semaphore_infos(&signals)];
        let queue = self.gpu.0.queue()?;
        self.gpu.0.submitting()?;
        // SAFETY: the queue is locked, the commands are complete, and their resources are kept.
        check("vkQueueSubmit2", unsafe {
            self.gpu.0.device.queue_submit2(*queue, &submits, vk::Fence::null())
        })?;
        drop(queue);
        self.submitted = value;
        let last = self.index(self.begun - 1);
        self.slots[last].value = value;
        Ok(Ticket(value))
    }

    /// Waits for a submission.
    pub fn wait(&self, ticket: Ticket) -> Result<()> {
        self.gpu.0.using_queue("vkWaitSemaphores")?;
        self.wait_for(ticket)
    }

    fn wait_for(&self, ticket: Ticket) -> Result<()> {
        let (semaphores, values) = ([self.timeline], [ticket.0]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the value was submitted, or is 0.
        check("vkWaitSemaphores", unsafe {
            self.gpu.0.device.wait_semaphores(&info, u64::MAX)
        })
    }

    /// Waits for all submissions and releases their resources at once, not only when the slots are reused.
    pub fn release(&mut self) -> Result<()> {
        self.wait(Ticket(self.submitted))?;
        self.slots.iter_mut().for_each(|slot| slot.reset(u64::MAX));
        Ok(())
    }

    /// True if a submission is done.
    pub fn is_done(&self, ticket: Ticket) -> Result<bool> {
        // SAFETY: the semaphore is alive.
        let value = unsafe { self.gpu.0.device.get_semaphore_counter_value(self.timeline) };
        Ok(check("vkGetSemaphoreCounterValue", value)? >= ticket.0)
    }

    /// Labels and nanoseconds of a submission, after waiting for it; empty once its slot has been reused.
    pub fn timings(&self, ticket: Ticket) -> Result<Vec<(&'static str, f64)>> {
        self.wait(ticket)?;
        let slot = self.slots.iter().find(|slot| slot.value == ticket.0);
        slot.and_then(|slot| slot.timestamps.as_ref())
            .map_or(Ok(Vec::new()), Timestamps::read)
    }

    /// Labels and nanoseconds of a frame in a host's commands that has run, until its slot is reused; `between` is the
    /// time of other commands between the pictures. Empty without timestamps.
    pub fn timings_in(&self, frame: u64) -> Result<Vec<(&'static str, f64)>> {
        let timestamps = &self.slots[self.index(frame)].timestamps;
        timestamps.as_ref().map_or(Ok(Vec::new()), Timestamps::read)
    }
}

impl Drop for Frames {
    fn drop(&mut self) {
        if self.guest.is_none() {
            // On a lost device waiting fails, but nothing runs, so that destroying is sound.
            let _ = self.wait_for(Ticket(self.submitted));
        }
        for slot in &mut self.slots {
            slot.kept.clear();
            // SAFETY: its commands are done; a null pool is ignored.
            unsafe { self.gpu.0.device.destroy_command_pool(slot.pool, None) };
        }
        // SAFETY: nothing waits for or signals it any more; a null one is ignored.
        unsafe { self.gpu.0.device.destroy_semaphore(self.timeline, None) };
    }
}
