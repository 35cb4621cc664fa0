//! Device memory of the controller, beside that of training.

use crate::gpu::TRANSFER_BYTES;
use crate::render::{Blocks, Capacity, Model, Need, Outputs, Purpose, RenderOptions, Scratch, isects_expected, total};
use crate::simplify::contribution::ContributionPass;
use crate::train::TrainSize;

/// Buffers of a run's count controller: those of its evaluator, and the larger of an evaluation and a survey.
pub fn controller_needs(size: &TrainSize) -> Vec<Need> {
    let [width, height] = size.image;
    let isects = size.isects.max(isects_expected(size.splats, width, height));
    let capacity = Capacity::for_image(size.splats, isects, width, height);
    let mut evaluation = Model::needs(Blocks::anywhere(size.counts()));
    // A scene is uploaded in pieces.
    let piece = TRANSFER_BYTES.min(total(&evaluation) as usize);
    evaluation.push(Need::new("staging", Purpose::Transfer, 1, piece));
    evaluation.push(Need::new("readback", Purpose::Transfer, 16, capacity.pixels));
    let outputs = Outputs {
        surfels: size.outputs.surfels,
        ..Outputs::default()
    };
    let survey = ContributionPass::needs(size.counts(), capacity, outputs);
    let task = if total(&survey) > total(&evaluation) {
        survey
    } else {
        evaluation
    };
    let evaluator = capacity.max(RenderOptions::default().capacity);
    [Scratch::needs(evaluator, outputs), task].concat()
}
