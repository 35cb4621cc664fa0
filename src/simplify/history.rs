//! History of the count controller: its decisions and their whole state, so that a resumed run decides alike.

use super::loss::{QualityLoss, ViewScores};
use super::{Decision, LossPoint};
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
    Evaluated,
    /// Growth ended.
    GrowthEnded,
    /// The least important splats were removed.
    Removed,
    /// The least important splats stayed.
    Rejected,
    /// SH coefficients were removed.
    ShReduced,
}

/// Scene with fewer splats or SH coefficients, after the same steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReducedScene {
    /// Number of splats.
    pub splats: usize,
    /// Scores of the held-out views.
    pub scores: ViewScores,
    /// Loss against the best scene since the end of growth; for SH coefficients, against the scene with all of them.
    pub loss: QualityLoss,
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
    /// Scores of the held-out views before the action.
    pub scores: ViewScores,
    /// The reduced scene that the action decided on.
    pub reduced: Option<ReducedScene>,
}

impl HistoryEntry {
    /// The action in words.
    fn name(&self) -> &'static str {
        match self.act {
            Act::Evaluated => "evaluated",
            Act::GrowthEnded => "growth ended",
            Act::Removed => "least important splats removed",
            Act::Rejected => "removal rejected",
            Act::ShReduced => "SH coefficients removed",
        }
    }
}

/// A round in progress: the same steps from the same state, first without the least important splats and then with
/// them, so that the runs differ in nothing else.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Iteration after which both runs start.
    pub from: u32,
    /// Splats of the first run, and scores of the held-out views and of views trained on, once it is done.
    pub without: Option<(usize, [ViewScores; 2])>,
}

/// Decisions of a run and the controller's state.
///
/// Unknown fields of a checkpoint are ignored: earlier controllers also merged neighbours in rounds, and marked this in
/// `is_merged` and `has_detail`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Constants of the controller, from the run's configuration.
    #[serde(skip)]
    pub config: AutoConfig,
    /// Phase of the run.
    pub phase: Phase,
    /// Round in progress.
    pub round: Option<Round>,
    /// Share of the splats that the next round removes.
    pub share: f64,
    /// Losses by accepted rounds: of the held-out views and of views trained on.
    pub lost: [ViewScores; 2],
    /// Iteration from which the count is fixed.
    pub settled_from: Option<u32>,
    /// Last iteration of the run, as far as known.
    pub end: u32,
    /// Whether the run may end on convergence.
    pub is_open: bool,
    /// Whether all SH coefficients stay.
    pub keeps_sh: bool,
    /// Actions so far.
    pub entries: Vec<HistoryEntry>,
}

impl History {
    /// Loss of the held-out views by count of splats: none at the end of growth, and those that rounds measured.
    pub fn points(&self) -> Vec<LossPoint> {
        let point = |entry: &HistoryEntry| match (entry.act, &entry.reduced) {
            (Act::GrowthEnded, _) => Some(LossPoint {
                splats: entry.splats,
                is_removed: true,
                loss: QualityLoss::default(),
            }),
            (Act::Removed | Act::Rejected, Some(reduced)) => Some(LossPoint {
                splats: reduced.splats,
                is_removed: entry.act == Act::Removed,
                loss: reduced.loss,
            }),
            _ => None,
        };
        self.entries.iter().filter_map(point).collect()
    }

    /// Largest count below `splats` that loses more than allowed even by the lower bound, if a round found any.
    pub fn least_splats(&self, splats: usize) -> Option<usize> {
        let points = self.points().into_iter();
        let too_few = points.filter(|point| point.splats < splats && point.loss.is_certain(&self.config));
        too_few.map(|point| point.splats).max()
    }

    /// Decisions as reported.
    pub fn steps(&self) -> Vec<Decision> {
        let step = |entry: &HistoryEntry| Decision {
            iteration: entry.iteration,
            act: entry.name().into(),
            splats: entry.splats,
            psnr_db: mean(&entry.scores.psnr_db),
            ssim: mean(&entry.scores.ssim),
            left: entry.reduced.as_ref().map(|reduced| reduced.splats),
            loss: entry.reduced.as_ref().map(|reduced| reduced.loss),
            decided_by: entry.reduced.as_ref().map(|reduced| {
                let (_, views, measure) = reduced.loss.share(&self.config);
                (views, measure)
            }),
        };
        self.entries.iter().map(step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::loss::{Estimate, Estimates};

    fn round(act: Act, splats: usize, left: usize, [low, high]: [f64; 2]) -> HistoryEntry {
        let psnr_db = Estimate {
            mean: 0.5 * (low + high),
            low,
            high,
        };
        HistoryEntry {
            act,
            splats,
            reduced: Some(ReducedScene {
                splats: left,
                loss: QualityLoss {
                    held_out: Estimates {
                        psnr_db,
                        ..Estimates::default()
                    },
                    ..QualityLoss::default()
                },
                ..ReducedScene::default()
            }),
            ..HistoryEntry::default()
        }
    }

    #[test]
    fn counts_that_surely_lose_too_much_bound_the_need_from_below() {
        let ended = HistoryEntry {
            act: Act::GrowthEnded,
            splats: 1000,
            ..HistoryEntry::default()
        };
        let reduced = round(Act::ShReduced, 700, 700, [0.0, 0.0]);
        let history = History {
            entries: vec![
                HistoryEntry::default(),
                ended,
                round(Act::Rejected, 1000, 500, [0.3, 0.5]),
                round(Act::Removed, 1000, 700, [0.0, 0.05]),
                round(Act::Rejected, 700, 600, [0.05, 0.2]),
                reduced,
            ],
            ..History::default()
        };
        let counts: Vec<usize> = history.points().iter().map(|point| point.splats).collect();
        assert_eq!(counts, [1000, 500, 700, 600]);
        // 600 splats may be enough: by the lower bound they lose little.
        assert_eq!(history.least_splats(700), Some(500));
        assert_eq!(history.least_splats(500), None);
    }

    /// Checkpoint of a controller with merging, within a round: rounds that merged are read as removals.
    #[test]
    fn states_with_marks_of_merging_load_as_without() -> serde_json::Result<()> {
        let history = History {
            phase: Phase::Pruning,
            round: Some(Round {
                from: 40,
                without: Some((5, Default::default())),
            }),
            share: 0.25,
            entries: vec![
                round(Act::Removed, 20, 10, [0.0; 2]),
                round(Act::Rejected, 10, 5, [0.5; 2]),
            ],
            ..History::default()
        };
        let mut saved = serde_json::to_value(&history)?;
        saved["has_detail"] = true.into();
        saved["round"]["is_merged"] = true.into();
        saved["entries"][0]["is_merged"] = true.into();
        saved["entries"][1]["is_merged"] = false.into();
        assert_eq!(serde_json::from_value::<History>(saved)?, history);
        Ok(())
    }

    #[test]
    fn decisions_say_which_views_and_which_measure_decided() {
        let history = History {
            entries: vec![HistoryEntry::default(), round(Act::Rejected, 10, 5, [0.5, 0.75])],
            ..History::default()
        };
        let steps = history.steps();
        assert_eq!((steps[0].left, steps[0].decided_by), (None, None));
        assert_eq!((steps[1].left, steps[1].act.as_str()), (Some(5), "removal rejected"));
        let by = steps[1].decided_by;
        assert_eq!(
            by,
            Some((crate::simplify::ViewSet::HeldOut, crate::simplify::Measure::Psnr))
        );
    }
}
