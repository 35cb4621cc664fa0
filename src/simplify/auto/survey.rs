//! Survey: effect of each splat on the views, rendered as in training.

use super::view_options;
use crate::Result;
use crate::render::{Compatibility, ViewOptions};
use crate::scene::Dataset;
use crate::simplify::contribution::{ContributionPass, Kernels, PassOptions};
use crate::simplify::sh_fit::ViewWeights;
use crate::train::Trainer;
use std::sync::Arc;

/// Contribution pass over views of the current scene.
pub(super) struct Survey<'a> {
    dataset: &'a Dataset,
    weigher: ContributionPass,
}

/// Rasterisation rules of training.
pub(super) const RULES: Compatibility = Compatibility::Engine;

impl<'a> Survey<'a> {
    pub(super) fn begin(kernels: &Arc<Kernels>, trainer: &mut Trainer<'_>, dataset: &'a Dataset) -> Result<Survey<'a>> {
        let ViewOptions { near, background, .. } = view_options(trainer);
        let options = PassOptions {
            near,
            background,
            compatibility: RULES,
        };
        let splats = trainer.splats()?;
        let weigher = ContributionPass::with(kernels.clone(), trainer.gpu(), &splats, options)?;
        Ok(Survey { dataset, weigher })
    }

    /// Change of the views by removal of each splat: squares summed over pixels and channels. Infinity for splats that
    /// no view shows, since views that look past the border of the photographs show them.
    pub(super) fn changes(&mut self, views: &[usize]) -> Result<Vec<f64>> {
        let mut sums = vec![(0.0, 0.0); self.weigher.splat_count()];
        for &view in views {
            let camera = self.dataset.views[view].camera;
            let found = self.weigher.removal_errors(&camera)?;
            for ((change, weight), removal_error) in sums.iter_mut().zip(found) {
                *change += f64::from(removal_error.change);
                *weight += f64::from(removal_error.weight);
            }
        }
        let change = |(change, weight)| if weight > 0.0 { change } else { f64::INFINITY };
        Ok(sums.into_iter().map(change).collect())
    }

    /// Weight of each splat in each view.
    pub(super) fn seen(&mut self, views: &[usize]) -> Result<Vec<ViewWeights>> {
        let seen = |&view: &usize| {
            let camera = self.dataset.views[view].camera;
            let found = self.weigher.removal_errors(&camera)?;
            let weights = found.iter().map(|removal_error| removal_error.weight).collect();
            Ok(ViewWeights { camera, weights })
        };
        views.iter().map(seen).collect()
    }
}
