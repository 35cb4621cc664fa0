//! Device memory of the controller, beside that of training.

use crate::render::{Capacity, Need, Outputs, Purpose, Scratch, isects_expected};
use crate::simplify::contribution::ContributionPass;
use crate::train::TrainSize;

/// Buffers of a run's count controller: those of its evaluator, which stay, and of a survey.
pub fn controller_needs(size: &TrainSize) -> Vec<Need> {
    let [width, height] = size.image;
    let isects = size.isects.max(isects_expected(size.splats, width, height));
    let capacity = Capacity::for_image(size.splats, isects, width, height);
    let mut needs = Scratch::needs(capacity, Outputs::default());
    needs.push(Need::new("readback", Purpose::Transfer, 16, capacity.pixels));
    needs.extend(ContributionPass::needs(size.counts(), capacity));
    needs
}
