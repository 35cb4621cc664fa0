//! The optimiser's state on the device.

use super::state::{HostState, Planes};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::render::{Block, Blocks, Model, Precision};
use crate::scene::RenderMode;

/// Parameters, gradients and moments in planes of vec4, and the statistics density control reads.
#[derive(Debug)]
pub(crate) struct DeviceState {
    /// The parameters, as rendering takes them.
    pub(crate) model: Model,
    /// Of every block where they are kept for someone to see, else of the one at hand.
    gradients: Vec<Buffer<[f32; 4]>>,
    pub(crate) moment1: Vec<Buffer<[f32; 4]>>,
    pub(crate) moment2: Vec<Buffer<[f32; 4]>>,
    pub(crate) statistics: Buffer<[f32; 4]>,
}

impl DeviceState {
    /// The most splats of a degree that the device has room for: what one binding reaches of the arrays that hold
    /// a vec4 for every splat, and parameters with their moments within its memory.
    pub(crate) fn splat_limit(gpu: &Gpu, sh_degree: u32) -> usize {
        let range = gpu.caps().max_storage_range.min(gpu.caps().max_allocation);
        let planes = Blocks::new(gpu.caps(), 1, sh_degree).planes as u64;
        let by_binding = range / 16;
        let by_memory = gpu.memory_limit() / (3 * 16 * planes);
        usize::try_from(by_binding.min(by_memory)).unwrap_or(usize::MAX)
    }

    /// Allocates for `state.len()` splats, no more: sizes change seldom, and room for growth would be paid for
    /// five times. Copies them there, to be drawn in `mode`; statistics start at 0.
    pub(crate) fn new(gpu: &Gpu, state: &HostState, mode: RenderMode) -> Result<DeviceState> {
        let room = state.len().max(1);
        let blocks = Blocks::new(gpu.caps(), room, state.sh_degree);
        let mut device = DeviceState {
            model: Model {
                params: blocks.buffers(gpu, "params")?,
                blocks,
                splat_count: 0,
                sh_degree: state.sh_degree,
                precision: Precision::Full,
                mode,
                not_finite: None,
            },
            gradients: vec![gpu.buffer("gradients", blocks.stride(0) * blocks.planes)?],
            moment1: blocks.buffers(gpu, "moment1")?,
            moment2: blocks.buffers(gpu, "moment2")?,
            statistics: gpu.buffer("statistics", room)?,
        };
        device.fill(gpu, state)?;
        Ok(device)
    }

    /// Where a block's gradients go.
    pub(crate) fn gradients(&self, block: Block) -> &Buffer<[f32; 4]> {
        &self.gradients[block.index.min(self.gradients.len() - 1)]
    }

    /// Gives every block gradients of its own, so that all of a step's can be seen.
    pub(crate) fn keep_gradients(&mut self, gpu: &Gpu) -> Result<()> {
        self.gradients = self.model.blocks.buffers(gpu, "gradients")?;
        Ok(())
    }

    /// Whether there is room for so many splats.
    pub(crate) fn fits(&self, state: &HostState) -> bool {
        state.len() <= self.model.blocks.room
    }

    /// Takes over a state that fits; statistics start at 0.
    pub(crate) fn fill(&mut self, gpu: &Gpu, state: &HostState) -> Result<()> {
        self.model.splat_count = state.len();
        for block in self.model.blocks.of(state.len()) {
            for (buffers, planes) in [
                (&self.model.params, &state.params),
                (&self.moment1, &state.m),
                (&self.moment2, &state.v),
            ] {
                for (i, plane) in planes.iter().enumerate() {
                    let at = block.plane(i).start;
                    gpu.upload(&buffers[block.index], at, &plane[block.splats()])?;
                }
            }
        }
        gpu.run(|rec| rec.fill(&self.statistics, 0))
    }

    fn planes(&self, gpu: &Gpu, buffers: &[Buffer<[f32; 4]>]) -> Result<Planes> {
        let (blocks, count) = (self.model.blocks, self.model.splat_count);
        let mut planes = vec![Vec::with_capacity(count); blocks.planes];
        for block in blocks.of(count) {
            for (i, plane) in planes.iter_mut().enumerate() {
                plane.extend(gpu.download(&buffers[block.index], block.plane(i))?);
            }
        }
        Ok(planes)
    }

    /// Copies parameters and moments to the host.
    pub(crate) fn download(&self, gpu: &Gpu) -> Result<HostState> {
        Ok(HostState {
            sh_degree: self.model.sh_degree,
            params: self.planes(gpu, &self.model.params)?,
            m: self.planes(gpu, &self.moment1)?,
            v: self.planes(gpu, &self.moment2)?,
        })
    }

    /// Copies the last step's gradients to the host, which must have been kept.
    pub(crate) fn download_gradients(&self, gpu: &Gpu) -> Result<Planes> {
        assert_eq!(
            self.gradients.len(),
            self.model.blocks.count(),
            "gradients were not kept"
        );
        self.planes(gpu, &self.gradients)
    }

    /// Copies the statistics to the host.
    pub(crate) fn download_statistics(&self, gpu: &Gpu) -> Result<Vec<[f32; 4]>> {
        gpu.download(&self.statistics, 0..self.model.splat_count)
    }
}
