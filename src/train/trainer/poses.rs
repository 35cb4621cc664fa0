//! Refinement of the photographs' poses between steps.

use super::Trainer;
use crate::gpu::{Readback, Recorder};
use crate::scene::{Camera, Dataset};
use crate::train::config::TrainConfig;
use crate::train::device::{DeviceState, pose_groups};
use crate::train::poses::{PoseState, RefinedPoses};
use crate::train::schedule;
use crate::{Error, Result};

/// Poses of a run that refines them.
pub(super) fn begin(
    dataset: &Dataset,
    views: &[usize],
    extent: f64,
    config: &TrainConfig,
    saved: Option<PoseState>,
) -> Result<Option<RefinedPoses>> {
    if !config.refine_poses {
        return Ok(None);
    }
    let poses = RefinedPoses::new(dataset, views, extent, saved);
    let other = || Error::Config("the saved poses are those of other photographs".into());
    poses.ok_or_else(other).map(Some)
}

/// Sums of a step for the gradient by the pose, if poses are refined.
pub(super) fn read_back(
    rec: &mut Recorder<'_>,
    state: &DeviceState,
    config: &TrainConfig,
) -> Result<Option<Readback<[f32; 4]>>> {
    if !config.refine_poses {
        return Ok(None);
    }
    let blocks = state.model.blocks.of(state.model.counts);
    let groups = pose_groups(blocks.map(|block| block.count));
    rec.read_back(&state.buffers.pose_sums, 0..2 * groups).map(Some)
}

impl Trainer<'_> {
    /// Poses after the last step begun; `None` if the run keeps the given ones. Waits for it.
    pub fn poses(&mut self) -> Result<Option<&RefinedPoses>> {
        self.settle()?;
        Ok(self.poses.as_ref())
    }

    /// The camera of the training view at a place, in its present pose.
    pub(super) fn refined(&self, place: usize, camera: &Camera) -> Camera {
        let poses = self.poses.as_ref();
        poses.map_or(*camera, |poses| poses.refined(place, camera))
    }

    /// Moves the poses, if this iteration does, at the end of an epoch. No step may be in flight.
    pub(super) fn update_poses(&mut self, iteration: u32) {
        let (config, views) = (&self.config, self.views.len());
        let Some(poses) = &mut self.poses else { return };
        match schedule::pose_rate(config, views, iteration) {
            Some(rate) => poses.update(&config.poses, rate, schedule::pose_updates(config, views)),
            None => poses.forget(),
        }
    }

    /// The data set with the training views in their present poses; `None` if the run keeps the given ones. Waits for
    /// the last step begun.
    pub fn refined_dataset(&mut self) -> Result<Option<Dataset>> {
        self.settle()?;
        let Some(poses) = &self.poses else { return Ok(None) };
        let mut dataset = self.dataset.clone();
        for (place, &view) in self.views.iter().enumerate() {
            let camera = &mut dataset.views[view].camera;
            *camera = poses.refined(place, camera);
        }
        Ok(Some(dataset))
    }
}
