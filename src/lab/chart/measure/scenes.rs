//! Models of the scene as settings draw it: in another precision, pruned, or with fewer harmonics.

use super::settings::FrameSetting;
use super::{SceneInputs, training};
use crate::Result;
use crate::render::{Compatibility, Model, Precision};
use crate::scene::{Camera, Split};
use crate::simplify::{ContributionPass, PassOptions, kept, prune, reduce_harmonics};
use std::borrow::Cow;
use std::rc::Rc;

/// Models of the settings, each made once.
pub(super) struct ModelCache<'a> {
    inputs: SceneInputs<'a>,
    /// Views that bound the error of pruning.
    pruned_by: Vec<Camera>,
    pass: ContributionPass,
    models: Vec<(ModelKey, Rc<Model>)>,
}

/// Errors at which splats are pruned and harmonics dropped, and the precision of a model.
type ModelKey = (Option<f64>, Option<f64>, Precision);

impl<'a> ModelCache<'a> {
    pub(super) fn new(inputs: SceneInputs<'a>) -> Result<ModelCache<'a>> {
        let pass_options = PassOptions {
            near: inputs.near(),
            background: training::BACKGROUND,
            compatibility: Compatibility::Engine,
        };
        Ok(ModelCache {
            pruned_by: inputs.cameras_of(Split::Train),
            pass: ContributionPass::new(inputs.gpu, inputs.splats, pass_options)?,
            inputs,
            models: Vec::new(),
        })
    }

    /// Flags of the splats that a setting does not draw; empty for none.
    pub(super) fn removed(&mut self, setting: &FrameSetting) -> Result<Vec<bool>> {
        let Some(error) = setting.pruned else {
            return Ok(Vec::new());
        };
        let found = prune(&mut self.pass, &self.pruned_by, error, &mut || true)?;
        Ok(found.map_or_else(Vec::new, |found| found.removed))
    }

    /// The setting's model, without the `removed` splats.
    pub(super) fn model(&mut self, setting: &FrameSetting, removed: &[bool]) -> Result<Rc<Model>> {
        let key = (setting.pruned, setting.reduced, setting.precision);
        if let Some((_, model)) = self.models.iter().find(|(known, _)| *known == key) {
            return Ok(Rc::clone(model));
        }
        let mut left = Cow::Borrowed(self.inputs.splats);
        if !removed.is_empty() {
            left = Cow::Owned(kept(&left, removed));
        }
        if let Some(error) = setting.reduced {
            left = Cow::Owned(reduce_harmonics(&left, error).splats);
        }
        let model = Rc::new(Model::upload_as(self.inputs.gpu, &left, setting.precision)?);
        self.models.push((key, Rc::clone(&model)));
        Ok(model)
    }
}
