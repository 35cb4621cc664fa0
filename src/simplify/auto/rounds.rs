//! Rounds: the same steps from the same state, without the least important splats or SH coefficients and with them.

use super::{CountController, Phase};
use crate::Result;
use crate::simplify::gain::{differences, estimate, steps_of_ten_percent};
use crate::simplify::held_out;
use crate::simplify::history::{Act, History, HistoryEntry, Round};
use crate::stats::mean;
use crate::train::{HostState, TrainConfig, Trainer};

impl<'a> CountController<'a> {
    pub(super) fn after_round_step(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let config = trainer.config();
        let steps = config.auto.round(config.iterations);
        let mut round = match self.history.round.take() {
            Some(round) if iteration >= round.from + steps => round,
            waiting => {
                self.history.round = waiting;
                return Ok(());
            }
        };
        let mut entry = self.look(trainer)?;
        entry.is_merged = round.is_merged;
        match (round.without.take(), self.kept.take()) {
            (None, Some(whole)) => {
                let without = (entry.splats, entry.psnr_db.clone());
                let less = trainer.download()?;
                round.train_psnr_db = self.train_psnr_db(trainer, &round)?;
                if is_surely_allowed(&self.history, &round, &without, whole.len()) {
                    entry.splats = whole.len();
                    let full_db = self.history.config.full_db;
                    entry.psnr_db = vec![full_db; self.held_out.view_count()];
                    let own = vec![full_db; round.train_psnr_db.len()];
                    return self.judge_any(trainer, (&round, own), entry, without, &less);
                }
                self.kept = Some(less);
                trainer.go_back(&whole, round.from)?;
                self.history.round = Some(Round {
                    without: Some(without),
                    ..round
                });
                Ok(())
            }
            (Some(without), Some(less)) => {
                let own = self.train_psnr_db(trainer, &round)?;
                self.judge_any(trainer, (&round, own), entry, without, &less)
            }
            // An incomplete checkpoint: the round is over.
            (_, None) => self.decide(trainer),
        }
    }

    /// PSNR of the views trained on, after a run of a round of splats; empty for other rounds.
    fn train_psnr_db(&mut self, trainer: &mut Trainer<'a>, round: &Round) -> Result<Vec<f64>> {
        match self.history.phase == Phase::Pruning && !round.is_without_sh {
            true => held_out::psnr_db(&mut self.trained, &trainer.splats()?, self.history.config.full_db),
            false => Ok(Vec::new()),
        }
    }

    /// Decides on a round of any kind from the full run, `entry` and `own` (PSNR of views trained on), and the reduced
    /// run, `without` (count, PSNR) and `less` (state).
    fn judge_any(
        &mut self,
        trainer: &mut Trainer<'a>,
        (round, own): (&Round, Vec<f64>),
        entry: HistoryEntry,
        without: (usize, Vec<f64>),
        less: &HostState,
    ) -> Result<()> {
        match self.history.phase {
            _ if round.is_without_sh => self.end_round_without_sh(trainer, entry, without, less),
            Phase::Lowering => self.end_lowering_round(trainer, entry, without),
            _ => {
                let own_lost = mean(&differences(&round.train_psnr_db, &own));
                self.judge_round(trainer, entry, (without, own_lost), less)
            }
        }
    }

    /// Decides on a round of splats: `entry` is the full run, `without` the reduced one, `own_lost` the PSNR that views
    /// trained on lost, decibels.
    fn judge_round(
        &mut self,
        trainer: &mut Trainer<'a>,
        mut entry: HistoryEntry,
        (without, own_lost): ((usize, Vec<f64>), f64),
        less: &HostState,
    ) -> Result<()> {
        let gone = steps_of_ten_percent(without.0, entry.splats).max(1e-9);
        let lost = differences(&without.1, &entry.psnr_db);
        let each: Vec<f64> = lost.iter().map(|lost| lost / gone).collect();
        let gain = estimate(&each);
        entry.gain_db = Some([gain.mean, gain.low]);
        let left = without.0;
        let is_perfect = self.history.config.is_full(&without.1);
        entry.without = Some(without);
        let cost = cost(&self.history, gain.mean, own_lost / gone);
        entry.lost_db = cost * gone;
        entry.act = Act::PruneResult;
        self.history.entries.push(entry);
        let tolerance = self.history.config.knee_tolerance;
        let is_beyond = |knee: f64| (left as f64) < (1.0 - tolerance) * knee;
        // A perfect result needs no law.
        let is_too_few = !is_perfect && self.history.knee().is_some_and(is_beyond);
        if cost > self.history.preference_db || is_too_few {
            self.history.miss();
        } else {
            trainer.replace(less)?;
        }
        self.history.share = next_share(&self.history, cost, trainer.splat_count());
        let config = trainer.config();
        let is_time = trainer.iteration() + config.auto.round(config.iterations) > until(config, &less.degrees);
        let least = self.history.knee().map_or(self.history.config.share_min, |_| tolerance);
        if !is_time && self.history.share >= least {
            return self.begin_round(trainer);
        }
        self.take_some(trainer)?;
        self.begin_lowering(trainer)
    }

    /// Where no law gives the knee and the last round was rejected by little, removes the share that would have been
    /// allowed, assuming that the worth of a tenth grows with the share. Without this, the final count would depend on
    /// where the last accepted round happened to end.
    fn take_some(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let nearly = self.history.nearly_allowed(self.history.config.partial_cost_max);
        let Some(share) = nearly.filter(|_| self.history.has_plateau()) else {
            return Ok(());
        };
        let mut entry = self.look(trainer)?;
        self.history.share = share;
        let lesser = self.lesser(trainer)?;
        trainer.replace(&lesser.less)?;
        let after = self.look(trainer)?;
        entry.act = Act::PartPruned;
        entry.is_merged = lesser.is_merged;
        entry.without = Some((after.splats, after.psnr_db));
        self.history.entries.push(entry);
        Ok(())
    }

    /// Starts a round: removes a share of the splats for its first half.
    pub(super) fn begin_round(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let lesser = self.lesser(trainer)?;
        trainer.replace(&lesser.less)?;
        let round = Round {
            is_merged: lesser.is_merged,
            ..Round::default()
        };
        self.start(trainer, lesser.whole, round);
        Ok(())
    }

    /// Starts a run of `round` from the trainer's state; `kept` is the state of the other run.
    pub(super) fn start(&mut self, trainer: &Trainer<'a>, kept: HostState, round: Round) {
        self.kept = Some(kept);
        let from = trainer.iteration();
        self.history.round = Some(Round { from, ..round });
    }
}

/// Whether the reduced run is accepted for any result of the full run, so that the full run can be skipped: scores are
/// capped at `full_db`, and with all splats they do not fall.
fn is_surely_allowed(history: &History, round: &Round, (left, psnr_db): &(usize, Vec<f64>), splats: usize) -> bool {
    let (preference, config) = (history.preference_db, &history.config);
    let [most_lost, most_own_lost] = [psnr_db, &round.train_psnr_db].map(|psnr_db| config.short_of_full(psnr_db));
    if round.is_without_sh {
        return !history.keeps_sh && most_lost <= config.sh_all_cost * preference;
    }
    // SH goes later, in the last fit: the full state is needed to go on.
    if history.phase == Phase::Lowering {
        return false;
    }
    let gone = steps_of_ten_percent(*left, splats).max(1e-9);
    let most = cost(history, most_lost / gone, most_own_lost / gone);
    // The next share depends on the loss, which must therefore be known to some precision.
    let unknown = most.min(config.short_of_full(history.psnr_db()) / gone);
    most <= preference && unknown <= config.cost_precision * preference
}

/// Cost of a round per tenth of splats, decibels, from the losses of held-out views and of views trained on.
fn cost(history: &History, lost_db: f64, own_lost_db: f64) -> f64 {
    let weighted_db = history.config.train_view_weight * own_lost_db;
    match weighted_db > history.preference_db {
        true => lost_db.max(weighted_db),
        false => lost_db,
    }
}

/// Next share to try, for `splats` splats after a round of cost `cost_db` per tenth: all splats beyond the knee, once
/// it is known. The knee is far steadier than the cost of single rounds, which are accepted or rejected partly by
/// chance.
fn next_share(history: &History, cost_db: f64, splats: usize) -> f64 {
    let Some(knee) = history.knee() else {
        return share_by_cost(history, cost_db);
    };
    let most = history.missed_share.map_or(history.config.share_max, |missed| {
        history.config.share_after_rejection * missed
    });
    (1.0 - knee / splats as f64).min(most)
}

/// Next share to try while no knee is known.
///
/// The next tenth costs more than the last ones on average. So a round at half the preference is followed by an equal
/// share, one at no cost by twice that, one at the full preference by half. After a rejected round the share is divided
/// by the root of its relative cost, so that the count does not hang on a large step being just allowed.
fn share_by_cost(history: &History, cost_db: f64) -> f64 {
    let (share, relative) = (history.share, cost_db / history.preference_db);
    if relative > 1.0 {
        return share * relative.sqrt().recip().clamp(0.5, history.config.share_after_rejection);
    }
    let most = history
        .missed_share
        .map_or(history.config.share_max, |missed| 0.75 * missed);
    (share * (2.0 - 2.0 * relative).clamp(0.5, 2.0)).min(most)
}

/// Iteration by which rounds of splats end. Without SH, the time of the SH round goes to splats.
fn until(config: &TrainConfig, degrees: &[u8]) -> u32 {
    match degrees.iter().all(|&degree| degree == 0) {
        true => config.auto.settle_by(config.iterations),
        false => config.auto.prune_until(config.iterations),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_are_trained_on_have_a_say_where_they_lose_much() {
        let history = History {
            preference_db: 0.08,
            ..History::default()
        };
        assert_eq!(cost(&history, -0.1, 0.15), -0.1);
        assert_eq!(cost(&history, -0.1, 0.2), 0.1);
        assert_eq!(cost(&history, 0.3, 0.2), 0.3);
    }

    #[test]
    fn what_is_nearly_perfect_without_splats_need_not_be_seen_with_them() {
        let stopped = |psnr_db: f64| HistoryEntry {
            act: Act::Stopped,
            splats: 1_100,
            psnr_db: vec![40.0, psnr_db],
            ..HistoryEntry::default()
        };
        let is_sure = |before_db: f64, after_db: f64, train_psnr_db: f64, keeps_sh, is_without_sh| {
            let history = History {
                preference_db: 0.1,
                phase: Phase::Pruning,
                keeps_sh,
                entries: vec![stopped(before_db)],
                ..History::default()
            };
            let round = Round {
                train_psnr_db: vec![train_psnr_db],
                is_without_sh,
                ..Round::default()
            };
            // A tenth of the splats is gone.
            is_surely_allowed(&history, &round, &(1_000, vec![40.0, after_db]), 1_100)
        };
        let is_round_sure = |before, after, own| is_sure(before, after, own, false, false);
        assert!(is_round_sure(40.0, 39.81, 40.0), "0.095 dB at most");
        assert!(!is_round_sure(40.0, 39.79, 40.0), "maybe 0.105 dB");
        assert!(!is_round_sure(39.0, 39.81, 40.0), "maybe a gain");
        assert!(is_round_sure(39.0, 40.0, 40.0), "0 dB at most");
        assert!(!is_round_sure(40.0, 40.0, 39.0), "maybe missed elsewhere");
        assert!(is_sure(39.0, 39.61, 0.0, false, true), "twice as much");
        assert!(!is_sure(40.0, 39.59, 0.0, false, true));
        assert!(!is_sure(40.0, 40.0, 40.0, true, true), "they stay anyway");
    }

    #[test]
    fn the_round_of_harmonics_is_one_of_splats_where_there_are_none() {
        for iterations in [500, 2_000, 30_000] {
            let config = TrainConfig::for_iterations(iterations);
            let [bare, other] = [[0, 0], [0, 1]].map(|degrees| until(&config, &degrees));
            assert!(other + config.auto.round(config.iterations) <= bare && bare < iterations);
        }
    }

    #[test]
    fn rounds_aim_at_the_knee_once_it_is_known() {
        let law = |splats: f64| 30.0 - 5.0 * (splats / 1e3).powf(-0.8);
        let round = |splats: usize, left: usize, act| HistoryEntry {
            act,
            splats,
            psnr_db: vec![law(splats as f64)],
            without: Some((left, vec![law(left as f64)])),
            lost_db: law(splats as f64) - law(left as f64),
            ..HistoryEntry::default()
        };
        let stopped = |psnr_db: f64| HistoryEntry {
            psnr_db: vec![psnr_db],
            without: None,
            ..round(40_000, 20_000, Act::Stopped)
        };
        let mut history = History {
            preference_db: 0.08,
            share: 0.5,
            entries: vec![stopped(29.0), round(40_000, 20_000, Act::PruneResult)],
            ..History::default()
        };
        assert_eq!(history.knee(), None, "two counts show no law");
        assert!(next_share(&history, 0.0, 20_000) > 0.5, "by what it cost");
        history.entries.push(round(20_000, 4_000, Act::Missed));
        let knee = history.knee().unwrap_or_default();
        let gain = law(1.1 * knee) - law(knee);
        assert!((gain - 0.08).abs() < 1e-6, "{knee}: {gain}");
        let share = next_share(&history, 1.0, 20_000);
        assert!((share - (1.0 - knee / 20_000.0)).abs() < 1e-9);
        history.missed_share = Some(0.1);
        assert!((next_share(&history, 1.0, 20_000) - 0.09).abs() < 1e-9);
        history.entries[0] = stopped(40.0);
        assert_eq!(history.knee(), None, "nothing is left to see");
    }

    #[test]
    fn the_next_share_goes_by_what_the_last_one_cost() {
        let history = |missed_share| History {
            preference_db: 0.03,
            share: 0.4,
            missed_share,
            ..History::default()
        };
        let near = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-12, "{found}");
        near(share_by_cost(&history(None), -0.1), 0.8);
        near(share_by_cost(&history(None), 0.015), 0.4);
        near(share_by_cost(&history(None), 0.03), 0.2);
        near(share_by_cost(&history(Some(0.5)), 0.0), 0.375);
        near(share_by_cost(&history(None), 0.06), 0.4 / 2_f64.sqrt());
        near(share_by_cost(&history(None), 3.0), 0.2);
        near(share_by_cost(&history(None), 0.031), 0.36);
    }
}
