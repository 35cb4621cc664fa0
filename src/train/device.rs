//! The optimiser's state on the device.

use super::state::{HostState, Planes};
use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::render::{Model, plane_count};
use crate::scene::RenderMode;

/// Parameters, gradients and moments in planes of vec4, and the statistics density control reads.
#[derive(Debug)]
pub(crate) struct DeviceState {
    /// The parameters, as rendering takes them.
    pub(crate) model: Model,
    pub(crate) gradients: Buffer<[f32; 4]>,
    pub(crate) moment1: Buffer<[f32; 4]>,
    pub(crate) moment2: Buffer<[f32; 4]>,
    pub(crate) statistics: Buffer<[f32; 4]>,
}

/// Room left for growth when buffers are made anew.
const HEADROOM: f64 = 1.25;

impl DeviceState {
    /// The most splats of a degree that one binding of the device holds.
    pub(crate) fn splat_limit(gpu: &Gpu, sh_degree: u32) -> usize {
        let range = gpu.caps().max_storage_range.min(gpu.caps().max_allocation);
        (range / (16 * plane_count(sh_degree) as u64)) as usize
    }

    /// Allocates for at least `state.len()` splats, to be drawn in `mode`, and copies them there; statistics
    /// start at 0.
    pub(crate) fn new(gpu: &Gpu, state: &HostState, mode: RenderMode) -> Result<DeviceState> {
        let limit = DeviceState::splat_limit(gpu, state.sh_degree);
        let stride = ((state.len() as f64 * HEADROOM) as usize)
            .min(limit)
            .max(state.len())
            .max(1);
        let len = stride * plane_count(state.sh_degree);
        let params = gpu.buffer("params", len)?;
        let mut device = DeviceState {
            model: Model {
                params,
                splat_count: 0,
                stride,
                sh_degree: state.sh_degree,
                mode,
            },
            gradients: gpu.buffer("gradients", len)?,
            moment1: gpu.buffer("moment1", len)?,
            moment2: gpu.buffer("moment2", len)?,
            statistics: gpu.buffer("statistics", stride)?,
        };
        device.fill(gpu, state)?;
        Ok(device)
    }

    /// Replaces the state, in new buffers only if it does not fit.
    pub(crate) fn replace(&mut self, gpu: &Gpu, state: &HostState) -> Result<()> {
        if state.len() <= self.model.stride {
            return self.fill(gpu, state);
        }
        *self = DeviceState::new(gpu, state, self.model.mode)?;
        Ok(())
    }

    fn fill(&mut self, gpu: &Gpu, state: &HostState) -> Result<()> {
        self.model.splat_count = state.len();
        let stride = self.model.stride;
        for (buffer, planes) in [
            (&self.model.params, &state.params),
            (&self.moment1, &state.m),
            (&self.moment2, &state.v),
        ] {
            for (i, plane) in planes.iter().enumerate() {
                gpu.upload(buffer, i * stride, plane)?;
            }
        }
        gpu.run(|rec| rec.fill(&self.statistics, 0))
    }

    fn planes(&self, gpu: &Gpu, buffer: &Buffer<[f32; 4]>) -> Result<Planes> {
        let (count, stride) = (self.model.splat_count, self.model.stride);
        (0..plane_count(self.model.sh_degree))
            .map(|plane| gpu.download(buffer, plane * stride..plane * stride + count))
            .collect()
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

    /// Copies the last step's gradients to the host.
    pub(crate) fn download_gradients(&self, gpu: &Gpu) -> Result<Planes> {
        self.planes(gpu, &self.gradients)
    }

    /// Copies the statistics to the host.
    pub(crate) fn download_statistics(&self, gpu: &Gpu) -> Result<Vec<[f32; 4]>> {
        gpu.download(&self.statistics, 0..self.model.splat_count)
    }
}
