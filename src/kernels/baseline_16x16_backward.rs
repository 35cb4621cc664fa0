//! A baseline, not used in training: the gradient of `baseline_16x16`, added up atomically.

pub use super::generated::baseline_16x16_backward::*;
use crate::gpu::{Groups, Recorder};

impl Baseline16x16Backward {
    /// Records it after clearing the sums; `groups` are 16x16 tiles.
    pub fn record_cleared(&self, rec: &mut Recorder<'_>, io: Bindings<'_>, groups: Groups<'_>) {
        rec.fill(io.sum_from_splat, 0);
        self.record(rec, io, groups);
    }
}
