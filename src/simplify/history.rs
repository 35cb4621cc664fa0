//! What has been tried and found in a run that ends with no more splats than its scene needs. All that its decisions go
//! by stands here, so that a resumed run decides alike.

use super::gain::{error, steps_of_ten_percent};
use super::{Decision, HalfResolution, Law};
use crate::stats::mean;
use crate::train::config::AutoConfig;
use serde::{Deserialize, Serialize};

/// What a run is at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Splats are added.
    #[default]
    Growing,
    /// The least of them are taken out, round by round.
    Pruning,
    /// Rounds show how many harmonics can go.
    Lowering,
    /// The count is decided; the held-out views say when training has converged.
    Converging,
    /// All training views are seen.
    Settled,
}

/// What was done at an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Act {
    /// Nothing: the held-out views were looked at.
    Looked,
    /// Training went over from photographs of half the size to whole ones.
    Enlarged,
    /// Growth ended.
    Stopped,
    /// The least important splats went.
    Pruned,
    /// The least important splats would have gone, had the held-out views not missed them.
    Missed,
    /// Of the splats that the last round missed, as many went as would have been allowed.
    PartPruned,
    /// Harmonics went.
    Lowered,
    /// It was found that harmonics can go, which they do in the last fit.
    Dispensable,
    /// It was found that harmonics must stay, since the held-out views miss them.
    Indispensable,
}

impl Entry {
    /// What was done, in words.
    fn name(&self) -> &'static str {
        match (self.act, self.is_merged) {
            (Act::Looked, _) => "looked",
            (Act::Enlarged, _) => "whole photographs from now on",
            (Act::Stopped, _) => "growth stopped",
            (Act::Pruned, false) => "the least important went",
            (Act::Pruned, true) => "neighbours merged",
            (Act::Missed, false) => "the least important would be missed, and stayed",
            (Act::Missed, true) => "merged neighbours would be missed, and stayed",
            (Act::PartPruned, _) => "as many of those went as would not have been missed",
            (Act::Lowered, _) => "harmonics went",
            (Act::Dispensable, _) => "harmonics would not be missed: they go in the last fit",
            (Act::Indispensable, _) => "harmonics would be missed, and stayed",
        }
    }
}

/// What was done, and what was seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Steps done.
    pub iteration: u32,
    /// What was done.
    pub act: Act,
    /// Splats, before anything went.
    pub splats: usize,
    /// PSNR with them, by held-out view; decibels. 40 where that was not tried, since no more could be missed.
    pub psnr_db: Vec<f64>,
    /// Splats without what went or would have gone, and the PSNR after the same steps, or at once where none were
    /// taken.
    pub without: Option<(usize, Vec<f64>)>,
    /// What a tenth more splats was worth, and its lower bound; decibels.
    pub gain_db: Option<[f64; 2]>,
    /// What all splats that went or would have gone were worth, as the decision counts it; decibels.
    #[serde(default)]
    pub lost_db: f64,
    /// Whether splats went by merging.
    #[serde(default)]
    pub is_merged: bool,
}

/// A round on its way: the same steps are taken from the same state twice, without the least important splats or
/// harmonics and then with them, so that nothing but their absence tells the two apart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// The iteration that both begin after.
    pub from: u32,
    /// Splats and PSNR of the first, once it is done.
    pub without: Option<(usize, Vec<f64>)>,
    /// Whether splats went by merging.
    #[serde(default)]
    pub is_merged: bool,
    /// Whether all harmonics went.
    #[serde(default, alias = "is_bare")]
    pub is_without_sh: bool,
    /// PSNR that some views which are trained on had after the first.
    #[serde(default, alias = "own_db")]
    pub train_psnr_db: Vec<f64>,
}

/// The course and the state of the decisions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// The smallest gain worth paying for: decibels for a tenth more splats.
    pub preference_db: f64,
    /// Constants of the controller, which the run's configuration holds.
    #[serde(skip)]
    pub config: AutoConfig,
    /// What the run is at.
    pub phase: Phase,
    /// The round on its way.
    pub round: Option<Round>,
    /// The share of splats that the next round tries to do without.
    pub share: f64,
    /// The smallest share that was missed.
    #[serde(default)]
    pub missed_share: Option<f64>,
    /// Whether merging has blurred what there is to see: then that is not tried again.
    #[serde(default)]
    pub has_detail: bool,
    /// Whether training sees photographs of half the size.
    #[serde(default)]
    pub is_half: bool,
    /// The mean squared error that photographs of half the size leave at least.
    #[serde(default)]
    pub lost_by_halving: f64,
    /// The iteration from which the count is fixed.
    pub settled_from: Option<u32>,
    /// The iteration that the run ends after, as far as is known.
    pub end: u32,
    /// Whether the run may end when it has converged.
    pub is_open: bool,
    /// The share of the harmonics that the next round tries to do without.
    #[serde(default)]
    pub sh_share: f64,
    /// The share of the harmonics that goes in the last fit; `None` if none does, and once it has gone.
    #[serde(default)]
    pub sh_goes: Option<f64>,
    /// What the held-out views lost by the harmonics that went or go in the last fit, decibels; `None` while there are
    /// none.
    pub sh_lost_db: Option<f64>,
    /// Whether all harmonics stay, whatever is found.
    #[serde(default, alias = "keeps_harmonics")]
    pub keeps_sh: bool,
    /// The course so far.
    pub entries: Vec<Entry>,
}

impl History {
    /// What the last round tried is missed.
    pub(super) fn miss(&mut self) {
        self.missed_share = Some(self.share);
        if let Some(entry) = self.entries.last_mut() {
            entry.act = Act::Missed;
        }
    }

    /// Splats, and the mean PSNR that the held-out views have with so many, as if all had been measured at the end of
    /// the last round: what a round lost is known free of time, and is added up from there.
    pub fn points(&self) -> Vec<[f64; 2]> {
        self.chain(|entry, without| mean(&entry.psnr_db) - mean(without))
    }

    /// The points by what the rounds' entries lost.
    fn chain(&self, lost: impl Fn(&Entry, &[f64]) -> f64) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        let mut level = None;
        for entry in self.entries.iter().rev() {
            let Some((left, without)) = &entry.without else {
                continue;
            };
            if !matches!(entry.act, Act::Pruned | Act::Missed) {
                continue;
            }
            let (splats, left) = (entry.splats as f64, *left as f64);
            let (with, lost) = (mean(&entry.psnr_db), lost(entry, without));
            let is_missed = entry.act == Act::Missed;
            let after = level.unwrap_or_else(|| {
                let end = if is_missed {
                    [splats, with]
                } else {
                    [left, with - lost]
                };
                points.push(end);
                end[1]
            });
            if is_missed {
                points.push([left, after - lost]);
                level = Some(after);
            } else {
                points.push([splats, after + lost]);
                level = Some(after + lost);
            }
        }
        points.reverse();
        points
    }

    /// The law through them.
    pub fn law(&self) -> Option<Law> {
        Law::through(&self.points())
    }

    /// Whether growth ended because nothing was left to gain: every held-out view was as good as can be seen.
    pub(super) fn has_plateau(&self) -> bool {
        let mut entries = self.entries.iter();
        let stopped = entries.find(|entry| entry.act == Act::Stopped);
        stopped.is_some_and(|stopped| self.config.is_full(&stopped.psnr_db))
    }

    /// The PSNR of the held-out views after what was done last.
    pub(super) fn psnr_db(&self) -> &[f64] {
        let Some(last) = self.entries.last() else {
            return &[];
        };
        match (&last.without, last.act) {
            (Some((_, psnr_db)), Act::Pruned | Act::PartPruned | Act::Lowered) => psnr_db,
            _ => &last.psnr_db,
        }
    }

    /// The share of the splats that the last round would have been allowed, where what it missed cost less than `most`
    /// times the preference, as if what a tenth is worth grew in proportion with the share.
    pub(super) fn nearly_allowed(&self, most: f64) -> Option<f64> {
        let last = self.entries.last()?;
        let (left, _) = last.without.as_ref().filter(|_| last.act == Act::Missed)?;
        let cost = last.lost_db / steps_of_ten_percent(*left, last.splats);
        let relative = cost / self.preference_db;
        let share = 1.0 - *left as f64 / last.splats as f64;
        (relative < most).then(|| share / relative.max(1.0))
    }

    /// The count at which a tenth more splats is worth just the preference, by the law through what was found so far;
    /// `None` while there is none. Nor is there one for views that are as good as can be seen, however many splats
    /// there are: they lose nothing at first, and then all at once.
    pub fn knee(&self) -> Option<f64> {
        if self.has_plateau() {
            return None;
        }
        let law = Law::through(&self.chain(|entry, _| entry.lost_db))?;
        Some(law.knee(self.preference_db))
    }

    /// For how long photographs of half the size were enough; `None` where that was not asked.
    pub fn half_size(&self) -> Option<HalfResolution> {
        let lost = self.lost_by_halving;
        let mut entries = self.entries.iter();
        let turn = entries.find(|entry| entry.act == Act::Enlarged);
        let hidden = |turn: &Entry| (lost / error(&turn.psnr_db)).min(1.0);
        let limit = -10.0 * lost.log10();
        (turn.is_some() || lost > 0.0).then(|| HalfResolution {
            until: turn.map_or(0, |turn| turn.iteration),
            limit_db: limit.is_finite().then_some(limit),
            hidden_share: turn.map(hidden),
        })
    }

    /// The course as a report has it.
    pub fn steps(&self) -> Vec<Decision> {
        let step = |entry: &Entry| Decision {
            iteration: entry.iteration,
            act: entry.name().into(),
            splats: entry.splats,
            psnr_db: mean(&entry.psnr_db),
            without: entry
                .without
                .as_ref()
                .map(|(splats, psnr)| (*splats, mean(psnr))),
            gain_db: entry.gain_db,
        };
        self.entries.iter().map(step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_half_the_size_hides_is_a_share_of_what_is_wrong() {
        let looked = |act, psnr_db: f64| Entry {
            iteration: 149,
            act,
            splats: 7,
            psnr_db: vec![psnr_db],
            without: None,
            gain_db: None,
            lost_db: 0.0,
            is_merged: false,
        };
        let mut history = History::default();
        assert_eq!(history.half_size(), None);
        history.lost_by_halving = 1e-4;
        let found = |history: &History| {
            history
                .half_size()
                .map(|half| (half.until, half.hidden_share))
        };
        assert_eq!(found(&history), Some((0, None)));
        history.entries = vec![looked(Act::Looked, 10.0), looked(Act::Enlarged, 30.0)];
        let half = history.half_size().unwrap_or_default();
        assert_eq!(half.until, 149);
        assert!((half.limit_db.unwrap_or_default() - 40.0).abs() < 1e-9);
        assert!((half.hidden_share.unwrap_or_default() - 0.1).abs() < 1e-9);
        history.lost_by_halving = 0.0;
        assert_eq!(history.half_size().and_then(|half| half.limit_db), None);
    }

    #[test]
    fn of_what_is_missed_by_little_some_is_allowed() {
        let history = |act, lost_db| History {
            preference_db: 0.08,
            entries: vec![Entry {
                iteration: 0,
                act,
                splats: 1_100,
                psnr_db: vec![40.0],
                without: Some((1_000, vec![39.0])),
                gain_db: None,
                lost_db,
                is_merged: false,
            }],
            ..History::default()
        };
        let found = history(Act::Missed, 0.12).nearly_allowed(2.0);
        assert!((found.unwrap_or_default() - (1.0 - 1.0 / 1.1) / 1.5).abs() < 1e-9);
        assert_eq!(history(Act::Missed, 0.17).nearly_allowed(2.0), None);
        assert_eq!(history(Act::Pruned, 0.12).nearly_allowed(2.0), None);
        assert_eq!(history(Act::Missed, 0.0).psnr_db(), [40.0]);
        assert_eq!(history(Act::Pruned, 0.0).psnr_db(), [39.0]);
    }

    #[test]
    fn what_rounds_lost_adds_up_whatever_time_has_gained() {
        let entry = |act, splats, with: f64, left, without: f64| Entry {
            iteration: 0,
            act,
            splats,
            psnr_db: vec![with],
            without: Some((left, vec![without])),
            gain_db: None,
            lost_db: 0.0,
            is_merged: false,
        };
        let looked = Entry {
            without: None,
            ..entry(Act::Looked, 500, 10.0, 0, 0.0)
        };
        let history = History {
            entries: vec![
                looked,
                entry(Act::Pruned, 1000, 20.0, 800, 19.5),
                entry(Act::Missed, 800, 24.0, 600, 22.0),
                entry(Act::Pruned, 800, 26.0, 700, 25.0),
            ],
            ..History::default()
        };
        let points = [[1000.0, 26.5], [600.0, 24.0], [800.0, 26.0], [700.0, 25.0]];
        assert_eq!(history.points(), points);
        let refused = History {
            entries: history.entries[..3].to_vec(),
            ..History::default()
        };
        let points = [[1000.0, 24.5], [600.0, 22.0], [800.0, 24.0]];
        assert_eq!(refused.points(), points);
    }
}
