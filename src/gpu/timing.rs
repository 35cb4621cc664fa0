//! Timestamps of one frame.

use super::check::check;
use super::device::Gpu;
use crate::Result;
use ash::vk;

/// Maximum number of timestamps of one frame; further ones are ignored.
const CAPACITY: u32 = 128;

/// Query pool with the label of each timestamp.
pub(super) struct Timestamps {
    gpu: Gpu,
    pool: vk::QueryPool,
    labels: Vec<&'static str>,
}

impl Timestamps {
    pub(super) fn new(gpu: &Gpu) -> Result<Timestamps> {
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(CAPACITY);
        gpu.0.creating("vkCreateQueryPool")?;
        // SAFETY: a plain query pool.
        let pool = check("vkCreateQueryPool", unsafe {
            gpu.0.device.create_query_pool(&info, None)
        })?;
        Ok(Timestamps {
            gpu: gpu.clone(),
            pool,
            labels: Vec::new(),
        })
    }

    pub(super) fn begin(&mut self, commands: vk::CommandBuffer) {
        self.labels.clear();
        // SAFETY: the commands are being recorded and the pool's last use has finished.
        unsafe { self.gpu.0.device.cmd_reset_query_pool(commands, self.pool, 0, CAPACITY) };
        self.mark(commands, "begin");
    }

    pub(super) fn mark(&mut self, commands: vk::CommandBuffer, label: &'static str) {
        let index = self.labels.len() as u32;
        if index == CAPACITY {
            return;
        }
        let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
        let device = &self.gpu.0.device;
        // SAFETY: the query was reset in `begin` and is written once.
        unsafe { device.cmd_write_timestamp2(commands, stage, self.pool, index) };
        self.labels.push(label);
    }

    /// Labels and the nanoseconds between each timestamp and the previous one, summed by label; empty where one is
    /// not written.
    pub(super) fn read(&self) -> Result<Vec<(&'static str, f64)>> {
        let mut ticks = vec![0u64; self.labels.len()];
        if ticks.is_empty() {
            return Ok(Vec::new());
        }
        let device = &self.gpu.0.device;
        let flags = vk::QueryResultFlags::TYPE_64;
        // SAFETY: the pool is alive.
        let read = unsafe { device.get_query_pool_results(self.pool, 0, &mut ticks, flags) };
        if read == Err(vk::Result::NOT_READY) {
            return Ok(Vec::new());
        }
        check("vkGetQueryPoolResults", read)?;
        let period = self.gpu.caps().timestamp_period_ns;
        let spans = ticks
            .windows(2)
            .map(|pair| pair[1].saturating_sub(pair[0]) as f64 * period);
        let mut stages: Vec<(&'static str, f64)> = Vec::new();
        for (&label, span) in self.labels[1..].iter().zip(spans) {
            match stages.iter_mut().find(|(known, _)| *known == label) {
                Some((_, sum)) => *sum += span,
                None => stages.push((label, span)),
            }
        }
        Ok(stages)
    }
}

impl Drop for Timestamps {
    fn drop(&mut self) {
        // SAFETY: the frame that used it has finished.
        unsafe { self.gpu.0.device.destroy_query_pool(self.pool, None) };
    }
}
