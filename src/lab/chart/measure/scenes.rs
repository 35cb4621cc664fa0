//! The scene as settings draw it: in other numbers, or without what can go.

use super::frames::Frames;
use super::settings::FrameSetting;
use super::training;
use crate::Result;
use crate::gpu::Gpu;
use crate::render::{Compatibility, Model, Precision};
use crate::simplify::{ContributionPass, PassOptions, kept, prune, reduce_harmonics};
use std::borrow::Cow;
use std::rc::Rc;

/// See the module. Each is made once.
pub(super) struct Scenes<'a> {
    gpu: &'a Gpu,
    frames: &'a Frames<'a>,
    weigher: ContributionPass,
    /// By error: which splats go.
    removed: Vec<(f64, Vec<bool>)>,
    models: Vec<(Key, Rc<Model>)>,
}

/// What settings of one model have in common: the errors at which splats and harmonics go, and the numbers.
type Key = (Option<f64>, Option<f64>, Precision);

impl<'a> Scenes<'a> {
    pub(super) fn new(gpu: &'a Gpu, frames: &'a Frames<'a>) -> Result<Scenes<'a>> {
        let pass_options = PassOptions {
            near: frames.near,
            background: training::BACKGROUND,
            compatibility: Compatibility::Engine,
        };
        Ok(Scenes {
            gpu,
            frames,
            weigher: ContributionPass::new(gpu, frames.splats, pass_options)?,
            removed: Vec::new(),
            models: Vec::new(),
        })
    }

    /// Which splats a setting does not draw; empty: none.
    pub(super) fn removed(&mut self, setting: &FrameSetting) -> Result<Vec<bool>> {
        let Some(error) = setting.pruned else {
            return Ok(Vec::new());
        };
        if let Some((_, removed)) = self.removed.iter().find(|(known, _)| *known == error) {
            return Ok(removed.clone());
        }
        let views = self.frames.pruned_by;
        let found = prune(&mut self.weigher, views, error, &mut || true)?;
        let removed = found.map_or_else(Vec::new, |found| found.removed);
        self.removed.push((error, removed.clone()));
        Ok(removed)
    }

    /// The setting's model.
    pub(super) fn model(&mut self, setting: &FrameSetting) -> Result<Rc<Model>> {
        let key = (setting.pruned, setting.reduced, setting.precision);
        if let Some((_, model)) = self.models.iter().find(|(known, _)| *known == key) {
            return Ok(Rc::clone(model));
        }
        let removed = self.removed(setting)?;
        let mut left = Cow::Borrowed(self.frames.splats);
        if !removed.is_empty() {
            left = Cow::Owned(kept(&left, &removed));
        }
        if let Some(error) = setting.reduced {
            left = Cow::Owned(reduce_harmonics(&left, error).splats);
        }
        let model = Rc::new(Model::upload_as(self.gpu, &left, setting.precision)?);
        self.models.push((key, Rc::clone(&model)));
        Ok(model)
    }
}
