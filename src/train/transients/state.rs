//! Scores of the photographs' patches, and the patches that are ignored.

use super::PatchGrid;
use super::regions::{RegionRule, regions};
use crate::scene::{Dataset, Split};
use crate::stats::quantile;
use crate::train::config::TransientConfig;

/// Share of a visit in the smoothed score.
const SMOOTHING: f64 = 0.5;

/// Visits before patches of a photograph are ignored.
const LEAST_VISITS: u32 = 2;

/// Least patches of a region.
const LEAST_PATCHES: usize = 2;

/// Patches between two steps, those of each photograph after those of the one before, in the order of the training
/// views.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TransientState {
    /// Smoothed score of each patch; negative without a pixel that counts.
    pub scores: Vec<f32>,
    /// A bit of each patch: ignored. Each photograph begins a word.
    pub ignored: Vec<u32>,
    /// Scored visits of each photograph.
    pub visits: Vec<u32>,
}

/// Patches of the training views that are left out of the loss.
#[derive(Clone, Debug)]
pub struct IgnoredPatches {
    grids: Vec<PatchGrid>,
    /// First score and first word of each photograph, and the ends.
    begins: Vec<[usize; 2]>,
    state: TransientState,
}

impl IgnoredPatches {
    /// Patches of the training views, none ignored, or those of a state; `None` if the state is one of other
    /// photographs.
    pub fn new(dataset: &Dataset, saved: Option<TransientState>) -> Option<IgnoredPatches> {
        let views = dataset.split(Split::Train).into_iter();
        let cameras = views.map(|view| dataset.views[view].camera);
        IgnoredPatches::of(cameras.map(|camera| [camera.width, camera.height]), saved)
    }

    fn of(sizes: impl Iterator<Item = [u32; 2]>, saved: Option<TransientState>) -> Option<IgnoredPatches> {
        let grids: Vec<PatchGrid> = sizes.map(|[width, height]| PatchGrid::of(width, height)).collect();
        let mut begins = vec![[0; 2]];
        for grid in &grids {
            let [score, word] = begins[begins.len() - 1];
            begins.push([score + grid.count(), word + grid.words()]);
        }
        let [scores, words] = begins[grids.len()];
        let state = saved.unwrap_or_else(|| TransientState {
            scores: vec![-1.0; scores],
            ignored: vec![0; words],
            visits: vec![0; grids.len()],
        });
        let lengths = [state.scores.len(), state.ignored.len(), state.visits.len()];
        let is_whole = lengths == [scores, words, grids.len()] && state.scores.iter().all(|score| score.is_finite());
        is_whole.then_some(IgnoredPatches { grids, begins, state })
    }

    /// State for a checkpoint.
    pub fn state(&self) -> &TransientState {
        &self.state
    }

    /// Patches of the training view at a place.
    pub fn grid(&self, place: usize) -> PatchGrid {
        self.grids[place]
    }

    /// Bits of the training view at a place, one of each patch: ignored.
    pub fn words(&self, place: usize) -> &[u32] {
        &self.state.ignored[self.begins[place][1]..self.begins[place + 1][1]]
    }

    /// Whether a patch of the training view at `place` is ignored.
    pub fn is_ignored(&self, place: usize, patch: usize) -> bool {
        self.words(place)[patch / 32] >> (patch % 32) & 1 != 0
    }

    /// Share of the patches of the training view at a place that are ignored.
    pub fn share(&self, place: usize) -> f64 {
        let ignored: u32 = self.words(place).iter().map(|word| word.count_ones()).sum();
        f64::from(ignored) / self.grids[place].count() as f64
    }

    /// Adds a visit: sums of the residuals of red, green and blue in each patch, and of the weights. Sums that are not
    /// finite, and patches of less than a pixel, tell nothing.
    pub(crate) fn add(&mut self, place: usize, sums: &[[f32; 4]]) {
        self.state.visits[place] += 1;
        let scores = &mut self.state.scores[self.begins[place][0]..self.begins[place + 1][0]];
        for (score, sums) in scores.iter_mut().zip(sums) {
            let [r, g, b, weight] = sums.map(f64::from);
            let found = ((r * r + g * g + b * b) / 3.0).sqrt() / weight;
            if weight < 1.0 || !found.is_finite() {
                continue;
            }
            let before = f64::from(*score);
            let smoothed = if before < 0.0 {
                found
            } else {
                before + SMOOTHING * (found - before)
            };
            *score = smoothed as f32;
        }
    }

    /// Finds the patches to be ignored anew, from the scores.
    pub(crate) fn update(&mut self, config: &TransientConfig) {
        let seed = self.threshold(config);
        for place in 0..self.grids.len() {
            let grid = self.grids[place];
            let [first, word] = self.begins[place];
            let patches = grid.count() as f64;
            let rule = RegionRule {
                seed,
                edge: seed * f64::from(config.edge),
                least: LEAST_PATCHES.max((patches * f64::from(config.least_share)).round() as usize),
                most: (patches * f64::from(config.most_share)) as usize,
            };
            let words = &mut self.state.ignored[word..word + grid.words()];
            words.fill(0);
            if self.state.visits[place] < LEAST_VISITS {
                continue;
            }
            let scores = &self.state.scores[first..first + grid.count()];
            let found = regions(grid, scores, rule).into_iter().enumerate();
            found
                .filter(|(_, is_inside)| *is_inside)
                .for_each(|(patch, _)| words[patch / 32] |= 1 << (patch % 32));
        }
    }

    /// Score from which a patch begins a region: `factor` times that of the typical photograph, the median over
    /// photographs of the score that `quantile` of a photograph's patches stay below.
    fn threshold(&self, config: &TransientConfig) -> f64 {
        let level = |pair: &[[usize; 2]]| {
            let scores = self.state.scores[pair[0][0]..pair[1][0]].iter();
            let mut known: Vec<f64> = scores.filter(|&&s| s >= 0.0).map(|&s| s.into()).collect();
            quantile(&mut known, config.quantile.into())
        };
        let mut levels: Vec<f64> = self.begins.windows(2).filter_map(level).collect();
        let typical = quantile(&mut levels, 0.5).unwrap_or(0.0);
        (f64::from(config.factor) * typical).max(config.least_score.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight photographs of 10 × 10 patches with scores from a level to an eighth more.
    fn begun(level: f32) -> IgnoredPatches {
        let mut patches = IgnoredPatches::of([[80, 80]; 8].into_iter(), None).unwrap_or_else(|| unreachable!());
        for visit in 0..8 {
            let sums = |patch: usize| [level * (1.0 + patch as f32 / 800.0), 0.0, 0.0, 1.0].map(|s| 64.0 * s);
            patches.add(visit, &(0..100).map(sums).collect::<Vec<_>>());
            patches.add(visit, &(0..100).map(sums).collect::<Vec<_>>());
        }
        patches
    }

    /// Visits that raise the scores of some patches.
    fn occlude(patches: &mut IgnoredPatches, place: usize, residual: f32, occluded: impl Fn(usize) -> bool) {
        for _ in 0..4 {
            let sums = |patch: usize| match occluded(patch) {
                true => [0.0, -residual, residual, 1.0].map(|s| 64.0 * s),
                false => [0.02, 0.0, 0.0, 1.0].map(|s| 64.0 * s),
            };
            patches.add(place, &(0..100).map(sums).collect::<Vec<_>>());
        }
        patches.update(&TransientConfig::default());
    }

    fn ignored(patches: &IgnoredPatches, place: usize) -> Vec<usize> {
        (0..100).filter(|&patch| patches.is_ignored(place, patch)).collect()
    }

    #[test]
    fn a_region_of_one_photograph_is_ignored_until_the_scene_agrees() {
        let mut patches = begun(0.02);
        let corner = |patch: usize| patch % 10 < 3 && patch < 30;
        occlude(&mut patches, 5, 0.3, corner);
        assert_eq!(ignored(&patches, 5), [0, 1, 2, 10, 11, 12, 20, 21, 22]);
        assert_eq!((patches.share(5), patches.share(4)), (0.09, 0.0));
        occlude(&mut patches, 5, 0.02, corner);
        assert_eq!(patches.share(5), 0.0);
    }

    #[test]
    fn no_more_than_the_cap_is_ignored_and_hard_scenes_raise_the_threshold() {
        let mut patches = begun(0.02);
        occlude(&mut patches, 2, 0.4, |patch| patch < 70);
        // Those later in the picture had higher scores before.
        assert_eq!(ignored(&patches, 2), (30..70).collect::<Vec<_>>());
        let mut hard = begun(0.2);
        occlude(&mut hard, 2, 0.4, |patch| patch < 20);
        assert_eq!(hard.share(2), 0.0);
    }

    #[test]
    fn what_tells_nothing_changes_nothing() {
        let mut patches = begun(0.02);
        let before = patches.state().scores.clone();
        patches.add(1, &[[f32::NAN, 0.0, 0.0, 64.0]; 100]);
        patches.add(1, &[[0.5, 0.0, 0.0, 0.5]; 100]);
        assert_eq!(patches.state().scores, before);
        let mut fresh = IgnoredPatches::of([[80, 80]].into_iter(), None).unwrap_or_else(|| unreachable!());
        fresh.update(&TransientConfig::default());
        fresh.add(0, &[[9.0, 9.0, 9.0, 1.0]; 100]);
        fresh.update(&TransientConfig::default());
        assert_eq!(fresh.share(0), 0.0, "one visit is not enough");
    }

    #[test]
    fn a_state_of_other_photographs_is_refused() {
        let state = begun(0.1).state().clone();
        let of = |count: usize, state: TransientState| IgnoredPatches::of((0..count).map(|_| [80, 80]), Some(state));
        assert!(of(8, state.clone()).is_some() && of(7, state.clone()).is_none());
        let mut broken = state;
        broken.scores[3] = f32::NAN;
        assert!(of(8, broken).is_none());
    }
}
