//! Candidate scenes of a round: the least important splats pruned, or neighbours merged.
//!
//! In regions without visible detail, merging replaces many splats by larger ones, which the training steps of a round
//! are too few to do. In detailed regions it blurs, and training recovers less of a blur than of missing splats, even
//! at equal error before training. So merging is only used where it loses no more than is allowed before training.

use super::CountController;
use super::survey::Survey;
use crate::Result;
use crate::scene::{Camera, Primitive, ScreenFilter, Splats};
use crate::simplify::loss::{QualityLoss, lost};
use crate::simplify::merge::{merge, rates};
use crate::train::{HostState, Trainer};

/// The full state and a state with fewer splats.
pub(super) struct Candidate {
    pub(super) whole: HostState,
    pub(super) less: HostState,
    /// Whether neighbours were merged.
    pub(super) is_merged: bool,
}

impl<'a> CountController<'a> {
    /// Candidate with `history.share` of the splats pruned or merged, before training.
    pub(super) fn candidate(&mut self, trainer: &mut Trainer<'a>) -> Result<Candidate> {
        let (whole, splats) = (trainer.download()?, trainer.splats()?);
        let left = (whole.len() as f64 * (1.0 - self.history.share)).ceil() as usize;
        if let Some(merged) = self.merged(trainer, &splats, left) {
            let config = self.history.config;
            let (before, after) = (self.scores(&splats)?, self.scores(&merged)?);
            let loss = QualityLoss::of(&lost(&before, &after, &self.history.lost));
            if loss.share(&config).0 <= 1.0 {
                return Ok(Candidate {
                    less: carried(&whole, &splats, &merged),
                    whole,
                    is_merged: true,
                });
            }
            self.history.has_detail = true;
        }
        // Held-out views are included: splats that only they see would otherwise go first. Only their cameras are used.
        let changes = Survey::begin(&self.kernels, trainer, self.dataset)?.changes(&self.all())?;
        Ok(Candidate {
            less: whole.select(&largest(&changes, left)),
            whole,
            is_merged: false,
        })
    }

    /// Scene with neighbours merged; `None` if merging has cost too much before, in mip mode, where merged splats would
    /// lack a filter, and for surfels, two of which are not flat together.
    fn merged(&self, trainer: &Trainer<'a>, splats: &Splats, left: usize) -> Option<Splats> {
        let config = trainer.config();
        let is_mergeable = config.kind == Primitive::Gaussian3d && config.filter == ScreenFilter::Classic;
        if self.history.has_detail || !is_mergeable {
            return None;
        }
        let camera = |&view: &usize| self.dataset.views[view].camera;
        let cameras: Vec<Camera> = self.all().iter().map(camera).collect();
        let rates = rates(splats, &cameras, f64::from(trainer.near()));
        let share = 1.0 - left as f64 / splats.len().max(1) as f64;
        merge(splats, &rates, share, &mut |_| true).map(|merged| merged.splats)
    }
}

/// Optimiser state of the merged scene. Unmerged splats, unchanged and in their old order, keep their moments.
fn carried(state: &HostState, before: &Splats, merged: &Splats) -> HostState {
    let mut carried = HostState::from_splats(merged, state.sh_degree);
    let mut old = 0;
    for row in 0..merged.len() {
        let is_same = |&old: &usize| {
            before.mean[old] == merged.mean[row]
                && before.log_scale[old] == merged.log_scale[row]
                && before.opacity_logit[old] == merged.opacity_logit[row]
        };
        let Some(found) = (old..before.len()).find(is_same) else {
            continue;
        };
        old = found + 1;
        for (to, from) in [(&mut carried.m, &state.m), (&mut carried.v, &state.v)] {
            for (to, from) in to.iter_mut().zip(from) {
                to[row] = from[found];
            }
        }
    }
    carried
}

/// Rows of the `count` largest numbers, ascending; ties go to the first row.
fn largest(numbers: &[f64], count: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..numbers.len() as u32).collect();
    let number = |row: u32| numbers[row as usize];
    order.sort_unstable_by(|&a, &b| number(b).total_cmp(&number(a)).then(a.cmp(&b)));
    order.truncate(count);
    order.sort_unstable();
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_stay_in_their_order() {
        let numbers = [0.5, 3.0, 0.5, 0.0, 2.0];
        assert_eq!(largest(&numbers, 3), [0, 1, 4]);
        assert_eq!(largest(&numbers, 9), [0, 1, 2, 3, 4]);
        assert!(largest(&[], 2).is_empty());
    }

    #[test]
    fn who_did_not_merge_keeps_moments() {
        let splats = |means: &[f32]| Splats {
            mean: means.iter().map(|&x| [x; 3]).collect(),
            quaternion: vec![[1.0, 0.0, 0.0, 0.0]; means.len()],
            log_scale: vec![[0.0; 3]; means.len()],
            opacity_logit: vec![0.0; means.len()],
            sh: vec![0.0; 3 * means.len()],
            ..Splats::default()
        };
        let before = splats(&[1.0, 2.0, 3.0, 4.0]);
        let mut state = HostState::from_splats(&before, 0);
        (0..4).for_each(|row| state.m[1][row] = [row as f32 + 1.0; 4]);
        let found = carried(&state, &before, &splats(&[1.0, 2.5, 4.0]));
        assert_eq!(found.m[1], [[1.0; 4], [0.0; 4], [4.0; 4]]);
        assert_eq!(found.params[0][1][0], 2.5);
    }
}
