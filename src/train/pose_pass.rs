//! Kernels of a step for the gradient by the camera's pose.

use super::config::TrainConfig;
use super::device::{DeviceState, pose_groups};
use crate::Result;
use crate::gpu::{Gpu, Groups, Recorder};
use crate::kernels::pose_gradient::{Bindings, Choice, Params, PoseGradient};
use crate::render::{Block, Scratch};

/// One kernel per SH degree; none if poses are not refined.
#[derive(Debug)]
pub(super) struct PosePass(Vec<PoseGradient>);

impl PosePass {
    /// Compiles the kernels that a run needs.
    pub(super) fn new(gpu: &Gpu, config: &TrainConfig) -> Result<PosePass> {
        let degrees = (0..=config.sh_degree).filter(|_| config.refine_poses);
        let kernel = |degree| PoseGradient::new(gpu, Choice::of_degree(degree));
        Ok(PosePass(degrees.map(kernel).collect::<Result<_>>()?))
    }

    /// Sums of a block's splats, whose gradients must be those of the step. Blocks have their places one after the
    /// other.
    pub(super) fn record(
        &self,
        rec: &mut Recorder<'_>,
        state: &DeviceState,
        scratch: &Scratch,
        sh_degree: u32,
        block: Block,
    ) {
        let Some(kernel) = self.0.get(sh_degree.min(block.degree) as usize) else {
            return;
        };
        let blocks = state.model.blocks.of(state.model.counts);
        let before = blocks.take_while(|other| other.first < block.first);
        kernel.record(
            rec,
            Bindings {
                view: &scratch.view,
                counts: &scratch.counts,
                params: &state.model.params[block.index],
                d_params: state.gradients(block),
                sums_from_group: &state.buffers.pose_sums,
            },
            Params {
                splat_count: block.count as u32,
                stride: block.stride as u32,
                first_group: pose_groups(before.map(|other| other.count)) as u32,
            },
            Groups::Count(pose_groups([block.count]) as u32),
        );
        rec.timestamp("pose_gradient");
    }
}
