//! Survey: effect of each splat on the views, rendered as in training.

use super::view_options;
use crate::metrics::Target;
use crate::render::{Compatibility, ViewOptions};
use crate::scene::Dataset;
use crate::simplify::contribution::{ContributionPass, Kernels, PassOptions};
use crate::simplify::sh_fit::ViewWeights;
use crate::train::Trainer;
use crate::{Result, io};
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

    /// Change of the views by removal of each splat: squares summed over pixels and channels.
    pub(super) fn changes(&mut self, views: &[usize]) -> Result<Vec<f64>> {
        let mut changes = vec![0.0; self.weigher.splat_count()];
        for &view in views {
            let camera = self.dataset.views[view].camera;
            let found = self.weigher.removal_errors(&camera, None)?;
            let sums = changes.iter_mut().zip(found);
            sums.for_each(|(sum, removal_error)| *sum += f64::from(removal_error.change));
        }
        Ok(changes)
    }

    /// Weight of each splat in each view.
    pub(super) fn seen(&mut self, views: &[usize]) -> Result<Vec<ViewWeights>> {
        let seen = |&view: &usize| {
            let camera = self.dataset.views[view].camera;
            let found = self.weigher.removal_errors(&camera, None)?;
            let weights = found.iter().map(|removal_error| removal_error.weight).collect();
            Ok(ViewWeights { camera, weights })
        };
        views.iter().map(seen).collect()
    }

    /// Share of each splat in the pixels' errors, relative to the mean splat's. At most `views_max` views are used;
    /// `turn` rotates them.
    pub(super) fn errors(&mut self, views: &[usize], views_max: usize, turn: usize) -> Result<Vec<f32>> {
        let step = views.len().div_ceil(views_max).max(1);
        let mut sums = vec![0.0; self.weigher.splat_count()];
        for &view in views.iter().skip(turn % step).step_by(step) {
            let view = &self.dataset.views[view];
            let photo = io::photo::load(view)?;
            let target = Target::new(&photo, self.dataset.alpha, self.weigher.pass_options().background);
            let judge = |planes: &[f32]| pixel_errors(planes, &target);
            let found = self.weigher.removal_errors(&view.camera, Some(&judge))?;
            let pairs = sums.iter_mut().zip(found);
            pairs.for_each(|(sum, removal_error)| *sum += f64::from(removal_error.error));
        }
        let mean = sums.iter().sum::<f64>() / sums.len().max(1) as f64;
        let relative = |sum: &f64| match mean > 0.0 {
            true => (sum / mean) as f32,
            false => 1.0,
        };
        Ok(sums.iter().map(relative).collect())
    }
}

/// Mean absolute error over the channels of each pixel, times the pixel's weight. `planes` are the rendered channels,
/// one after the other.
fn pixel_errors(planes: &[f32], target: &Target) -> Vec<f32> {
    let pixels = target.rgb.len();
    let error = |pixel: usize| {
        let off = |channel: usize| planes[channel * pixels + pixel] - target.rgb[pixel][channel];
        let counts = target.weights.as_ref().map_or(1.0, |w| w[pixel]);
        (0..3).map(|c| off(c).abs()).sum::<f32>() / 3.0 * counts
    };
    (0..pixels).map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_means_over_channels_and_count_as_their_pixels_do() {
        let target = Target {
            width: 2,
            height: 1,
            rgb: vec![[0.5, 0.5, 0.5], [1.0, 0.0, 0.0]],
            weights: Some(vec![1.0, 0.5]),
        };
        let planes = [0.5, 0.0, 0.8, 0.0, 0.5, 0.5];
        let found = pixel_errors(&planes, &target);
        assert!((found[0] - 0.1).abs() < 1e-6 && (found[1] - 0.25).abs() < 1e-6);
    }
}
