//! History of the count controller: its decisions and their whole state, so that a resumed run decides alike.

use super::gain::{error, steps_of_ten_percent};
use super::{Decision, HalfResolution, Law};
use crate::stats::mean;
use crate::train::config::AutoConfig;
use serde::{Deserialize, Serialize};

/// Phase of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Splats are added.
    #[default]
    Growing,
    /// The least important splats are removed, round by round.
    Pruning,
    /// Rounds decide how many SH coefficients can go.
    Lowering,
    /// The count is fixed; held-out views decide when training has converged.
    Converging,
    /// The last fit, on all training views.
    Settled,
}

/// Action at an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Act {
    /// No action: an evaluation of the held-out views.
    #[default]
    Looked,
    /// Change from half-size photographs to full size.
    Enlarged,
    /// Growth ended.
    Stopped,
    /// The least important splats were removed.
    PruneResult,
    /// Removal of the least important splats was rejected by the held-out views.
    Missed,
    /// The part of a rejected round's splats that would have been allowed was removed.
    PartPruned,
    /// SH coefficients were removed.
    Lowered,
    /// A round found SH coefficients dispensable; they go in the last fit.
    Dispensable,
    /// A round found SH coefficients indispensable for the held-out views.
    Indispensable,
}

impl HistoryEntry {
    /// The action in words.
    fn name(&self) -> &'static str {
        match (self.act, self.is_merged) {
            (Act::Looked, _) => "looked",
            (Act::Enlarged, _) => "whole photographs from now on",
            (Act::Stopped, _) => "growth stopped",
            (Act::PruneResult, false) => "the least important went",
            (Act::PruneResult, true) => "neighbours merged",
            (Act::Missed, false) => "the least important would be missed, and stayed",
            (Act::Missed, true) => "merged neighbours would be missed, and stayed",
            (Act::PartPruned, _) => "as many of those went as would not have been missed",
            (Act::Lowered, _) => "harmonics went",
            (Act::Dispensable, _) => "harmonics would not be missed: they go in the last fit",
            (Act::Indispensable, _) => "harmonics would be missed, and stayed",
        }
    }
}

/// An action with the evaluation before it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HistoryEntry {
    /// Steps done.
    pub iteration: u32,
    /// The action.
    pub act: Act,
    /// Splats before the action.
    pub splats: usize,
    /// PSNR with all splats, by held-out view, decibels; 40 (the cap) if the full run was skipped.
    pub psnr_db: Vec<f64>,
    /// Splats without the removed or proposed ones, and the PSNR after equally many steps, or at once if there were
    /// none.
    pub without: Option<(usize, Vec<f64>)>,
    /// Gain of a tenth more splats and its lower bound, decibels.
    pub gain_db: Option<[f64; 2]>,
    /// Cost of all removed or proposed splats, as the decision counts it, decibels.
    #[serde(default)]
    pub lost_db: f64,
    /// Whether the splats were merged.
    #[serde(default)]
    pub is_merged: bool,
}

/// A round in progress: the same steps from the same state, first without the least important splats or SH coefficients
/// and then with them, so that the runs differ in nothing else.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Iteration after which both runs start.
    pub from: u32,
    /// Splats and PSNR of the first run, once it is done.
    pub without: Option<(usize, Vec<f64>)>,
    /// Whether splats were merged.
    #[serde(default)]
    pub is_merged: bool,
    /// Whether all SH was removed.
    #[serde(default, alias = "is_bare")]
    pub is_without_sh: bool,
    /// PSNR of some views trained on, after the first run.
    #[serde(default, alias = "own_db")]
    pub train_psnr_db: Vec<f64>,
}

/// Decisions of a run and the controller's state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Smallest gain worth a tenth more splats, decibels.
    pub preference_db: f64,
    /// Constants of the controller, from the run's configuration.
    #[serde(skip)]
    pub config: AutoConfig,
    /// Phase of the run.
    pub phase: Phase,
    /// Round in progress.
    pub round: Option<Round>,
    /// Share of the splats that the next round removes.
    pub share: f64,
    /// Smallest rejected share.
    #[serde(default)]
    pub missed_share: Option<f64>,
    /// Whether a merge has blurred visible detail; no further merge is tried then.
    #[serde(default)]
    pub has_detail: bool,
    /// Whether training uses half-size photographs.
    #[serde(default)]
    pub is_half: bool,
    /// Mean squared error of the photographs at half size: a lower bound for scenes fitted to them.
    #[serde(default)]
    pub lost_by_halving: f64,
    /// Iteration from which the count is fixed.
    pub settled_from: Option<u32>,
    /// Last iteration of the run, as far as known.
    pub end: u32,
    /// Whether the run may end on convergence.
    pub is_open: bool,
    /// Share of the SH floats that the next round removes.
    #[serde(default)]
    pub sh_share: f64,
    /// Share of the SH floats that goes in the last fit; `None` if none does, and once it has gone.
    #[serde(default)]
    pub sh_goes: Option<f64>,
    /// Loss of the held-out views by SH removed now or in the last fit, decibels; `None` if there is none.
    pub sh_lost_db: Option<f64>,
    /// Whether all SH stays, regardless of the rounds.
    #[serde(default, alias = "keeps_harmonics")]
    pub keeps_sh: bool,
    /// Actions so far.
    pub entries: Vec<HistoryEntry>,
}

impl History {
    /// Marks the last round as rejected.
    pub(super) fn miss(&mut self) {
        self.missed_share = Some(self.share);
        if let Some(entry) = self.entries.last_mut() {
            entry.act = Act::Missed;
        }
    }

    /// Points (splats, mean PSNR of the held-out views), as if all had been measured at the end of the last round:
    /// losses within a round are free of time's share, and are added up from there.
    pub fn points(&self) -> Vec<[f64; 2]> {
        self.chain(|entry, without| mean(&entry.psnr_db) - mean(without))
    }

    /// Points from the given loss of each round.
    fn chain(&self, lost: impl Fn(&HistoryEntry, &[f64]) -> f64) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        let mut level = None;
        for entry in self.entries.iter().rev() {
            let Some((left, without)) = &entry.without else {
                continue;
            };
            if !matches!(entry.act, Act::PruneResult | Act::Missed) {
                continue;
            }
            let (splats, left) = (entry.splats as f64, *left as f64);
            let (with, lost) = (mean(&entry.psnr_db), lost(entry, without));
            let is_missed = entry.act == Act::Missed;
            let after = level.unwrap_or_else(|| {
                let end = if is_missed { [splats, with] } else { [left, with - lost] };
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

    /// Law through [`History::points`].
    pub fn law(&self) -> Option<Law> {
        Law::through(&self.points())
    }

    /// Whether growth ended because every held-out view was perfect.
    pub(super) fn has_plateau(&self) -> bool {
        let mut entries = self.entries.iter();
        let stopped = entries.find(|entry| entry.act == Act::Stopped);
        stopped.is_some_and(|stopped| self.config.is_full(&stopped.psnr_db))
    }

    /// PSNR of the held-out views after the last action.
    pub(super) fn psnr_db(&self) -> &[f64] {
        let Some(last) = self.entries.last() else {
            return &[];
        };
        match (&last.without, last.act) {
            (Some((_, psnr_db)), Act::PruneResult | Act::PartPruned | Act::Lowered) => psnr_db,
            _ => &last.psnr_db,
        }
    }

    /// Share of the splats that the last round would have been allowed to remove, if it was rejected at a cost below
    /// `most` times the preference; the cost of a tenth is taken as proportional to the share.
    pub(super) fn nearly_allowed(&self, most: f64) -> Option<f64> {
        let last = self.entries.last()?;
        let (left, _) = last.without.as_ref().filter(|_| last.act == Act::Missed)?;
        let cost = last.lost_db / steps_of_ten_percent(*left, last.splats);
        let relative = cost / self.preference_db;
        let share = 1.0 - *left as f64 / last.splats as f64;
        (relative < most).then(|| share / relative.max(1.0))
    }

    /// Number of splats at which a tenth more is worth the preference, by the law through all rounds; `None` without a
    /// law, and for views that are perfect: removal costs them nothing at first and then everything at once.
    pub fn knee(&self) -> Option<f64> {
        if self.has_plateau() {
            return None;
        }
        let law = Law::through(&self.chain(|entry, _| entry.lost_db))?;
        Some(law.knee(self.preference_db))
    }

    /// Use of half-size photographs; `None` if never considered.
    pub fn half_size(&self) -> Option<HalfResolution> {
        let lost = self.lost_by_halving;
        let mut entries = self.entries.iter();
        let turn = entries.find(|entry| entry.act == Act::Enlarged);
        let hidden = |turn: &HistoryEntry| (lost / error(&turn.psnr_db)).min(1.0);
        let limit = -10.0 * lost.log10();
        (turn.is_some() || lost > 0.0).then(|| HalfResolution {
            until: turn.map_or(0, |turn| turn.iteration),
            limit_db: limit.is_finite().then_some(limit),
            hidden_share: turn.map(hidden),
        })
    }

    /// Decisions as reported.
    pub fn steps(&self) -> Vec<Decision> {
        let step = |entry: &HistoryEntry| Decision {
            iteration: entry.iteration,
            act: entry.name().into(),
            splats: entry.splats,
            psnr_db: mean(&entry.psnr_db),
            without: entry.without.as_ref().map(|(splats, psnr)| (*splats, mean(psnr))),
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
        let looked = |act, psnr_db: f64| HistoryEntry {
            iteration: 149,
            act,
            splats: 7,
            psnr_db: vec![psnr_db],
            ..HistoryEntry::default()
        };
        let mut history = History::default();
        assert_eq!(history.half_size(), None);
        history.lost_by_halving = 1e-4;
        let found = |history: &History| history.half_size().map(|half| (half.until, half.hidden_share));
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
            entries: vec![HistoryEntry {
                act,
                splats: 1_100,
                psnr_db: vec![40.0],
                without: Some((1_000, vec![39.0])),
                lost_db,
                ..HistoryEntry::default()
            }],
            ..History::default()
        };
        let found = history(Act::Missed, 0.12).nearly_allowed(2.0);
        assert!((found.unwrap_or_default() - (1.0 - 1.0 / 1.1) / 1.5).abs() < 1e-9);
        assert_eq!(history(Act::Missed, 0.17).nearly_allowed(2.0), None);
        assert_eq!(history(Act::PruneResult, 0.12).nearly_allowed(2.0), None);
        assert_eq!(history(Act::Missed, 0.0).psnr_db(), [40.0]);
        assert_eq!(history(Act::PruneResult, 0.0).psnr_db(), [39.0]);
    }

    #[test]
    fn what_rounds_lost_adds_up_whatever_time_has_gained() {
        let entry = |act, splats, with: f64, left, without: f64| HistoryEntry {
            act,
            splats,
            psnr_db: vec![with],
            without: Some((left, vec![without])),
            ..HistoryEntry::default()
        };
        let looked = HistoryEntry {
            splats: 500,
            psnr_db: vec![10.0],
            ..HistoryEntry::default()
        };
        let history = History {
            entries: vec![
                looked,
                entry(Act::PruneResult, 1000, 20.0, 800, 19.5),
                entry(Act::Missed, 800, 24.0, 600, 22.0),
                entry(Act::PruneResult, 800, 26.0, 700, 25.0),
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
