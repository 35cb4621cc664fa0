//! Refinement of the photographs' poses between steps.

use super::Trainer;
use crate::render::ViewOptions;
use crate::scene::{Camera, Dataset};
use crate::train::config::TrainConfig;
use crate::train::poses::{PoseAdjustment, PoseState, RefinedPoses};
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

    /// Adjusts the poses to the scene. No step may be in flight.
    pub(super) fn adjust_poses(&mut self) -> Result<()> {
        let near = self.near();
        let Some(poses) = &mut self.poses else { return Ok(()) };
        let adjustment = PoseAdjustment {
            dataset: self.dataset,
            views: &self.views,
            extent: self.extent,
            options: ViewOptions {
                background: [0.0; 3],
                near,
                filter: self.config.filter,
            },
        };
        adjustment.adjust(&self.gpu, &self.state.model, poses)
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
