//! Rounds: the same steps from the same state without the least important splats, or harmonics, and with them.

use super::{Phase, Thrift, prune_by};
use crate::Result;
use crate::parsimony::gain::{differences, estimate, mean, tenths};
use crate::parsimony::ledger::{Act, Entry, Ledger, Round};
use crate::train::{HostState, TrainConfig, Trainer};

/// The share of splats that the first round takes out.
pub(super) const SHARE: f64 = 0.5;

/// No round takes more than this share.
const SHARE_MAX: f64 = 0.8;

/// What a tenth of the splats is worth to views that are trained on counts so much: few views, far apart, may be so badly
/// foreseen that they hardly miss any splat, and what they judge would no longer be the scene of the photographs.
const OWN: f64 = 0.5;

/// Rounds stop at this share: what one of so few is worth cannot be told from chance.
const SHARE_MIN: f64 = 0.1;

impl<'a> Thrift<'a> {
    pub(super) fn attend_round(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let steps = round(trainer.config());
        let round = match self.ledger.round.take() {
            Some(round) if iteration >= round.from + steps => round,
            waiting => {
                self.ledger.round = waiting;
                return Ok(());
            }
        };
        let mut entry = self.look(trainer)?;
        entry.is_merged = round.is_merged;
        match (round.without, self.kept.take()) {
            (None, Some(whole)) => {
                self.kept = Some(trainer.download()?);
                let own_db = self.own.score(&trainer.splats()?)?;
                trainer.go_back(&whole, round.from)?;
                self.ledger.round = Some(Round {
                    without: Some((entry.splats, entry.psnr_db)),
                    own_db,
                    ..round
                });
                Ok(())
            }
            (Some(without), Some(less)) if round.is_bare => {
                self.judge_bare(trainer, entry, without, &less)
            }
            (Some(without), Some(less)) if self.ledger.phase == Phase::Lowering => {
                self.judge_lowering(trainer, entry, without, &less)
            }
            (Some(without), Some(less)) => {
                let own = self.own.score(&trainer.splats()?)?;
                let own_lost = mean(&differences(&round.own_db, &own));
                self.judge_round(trainer, entry, (without, own_lost), &less)
            }
            // A checkpoint that lacks what it should hold: the round is over.
            (_, None) => self.decide(trainer),
        }
    }

    /// Compares what the same steps have led to with all splats, `entry`, and without the least important.
    fn judge_round(
        &mut self,
        trainer: &mut Trainer<'a>,
        mut entry: Entry,
        (without, own_lost): ((usize, Vec<f64>), f64),
        less: &HostState,
    ) -> Result<()> {
        let gone = tenths(without.0, entry.splats).max(1e-9);
        let lost = differences(&without.1, &entry.psnr_db);
        let each: Vec<f64> = lost.iter().map(|lost| lost / gone).collect();
        let gain = estimate(&each);
        entry.gain_db = Some([gain.mean, gain.low]);
        entry.without = Some(without);
        let preference = self.ledger.preference_db;
        let cost = cost(gain.mean, own_lost / gone, preference);
        if cost > preference {
            entry.act = Act::Missed;
            self.ledger.missed_share = Some(self.ledger.share);
        } else {
            entry.act = Act::Pruned;
            trainer.replace(less)?;
        }
        self.ledger.share = next_share(&self.ledger, cost);
        self.ledger.entries.push(entry);
        let config = trainer.config();
        let is_time = trainer.iteration() + round(config) > prune_by(config);
        match is_time || self.ledger.share < SHARE_MIN {
            true => self.begin_lowering(trainer),
            false => self.begin_round(trainer),
        }
    }

    /// Takes out a share of the splats, for the steps of a round.
    pub(super) fn begin_round(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let lesser = self.lesser(trainer)?;
        let round = self.try_without(trainer, lesser.whole, &lesser.less)?;
        round.is_merged = lesser.is_merged;
        Ok(())
    }

    /// Takes the first steps of a round from the lesser state.
    pub(super) fn try_without(
        &mut self,
        trainer: &mut Trainer<'a>,
        whole: HostState,
        less: &HostState,
    ) -> Result<&mut Round> {
        trainer.replace(less)?;
        self.kept = Some(whole);
        Ok(self.ledger.round.insert(Round {
            from: trainer.iteration(),
            ..Round::default()
        }))
    }
}

/// What a round has cost for every tenth, by what held-out views lost and those that are trained on.
fn cost(lost_db: f64, own_lost_db: f64, preference_db: f64) -> f64 {
    match OWN * own_lost_db > preference_db {
        true => lost_db.max(OWN * own_lost_db),
        false => lost_db,
    }
}

/// The share to try after a round that cost so much for every tenth.
///
/// The next tenth costs more than the last ones on average. So a round that cost half of what it might is followed by as
/// large a share again, one that cost nothing by twice that, one that cost all of it by half. After one that was missed,
/// the share shrinks with the root of what it cost too much: that keeps the count from hanging on whether a large step was
/// just allowed or just not.
fn next_share(ledger: &Ledger, cost_db: f64) -> f64 {
    let (share, relative) = (ledger.share, cost_db / ledger.preference_db);
    if relative > 1.0 {
        return share * relative.sqrt().recip().clamp(0.5, 0.9);
    }
    let most = ledger
        .missed_share
        .map_or(SHARE_MAX, |missed| 0.75 * missed);
    (share * (2.0 - 2.0 * relative).clamp(0.5, 2.0)).min(most)
}

/// Steps of a round's fit.
pub(super) fn round(config: &TrainConfig) -> u32 {
    (config.iterations / 20).clamp(25, 500)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_are_trained_on_have_a_say_where_they_lose_much() {
        assert_eq!(cost(-0.1, 0.15, 0.08), -0.1);
        assert_eq!(cost(-0.1, 0.2, 0.08), 0.1);
        assert_eq!(cost(0.3, 0.2, 0.08), 0.3);
    }

    #[test]
    fn the_next_share_goes_by_what_the_last_one_cost() {
        let ledger = |missed_share| Ledger {
            preference_db: 0.03,
            share: 0.4,
            missed_share,
            ..Ledger::default()
        };
        let near = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-12, "{found}");
        near(next_share(&ledger(None), -0.1), 0.8);
        near(next_share(&ledger(None), 0.015), 0.4);
        near(next_share(&ledger(None), 0.03), 0.2);
        near(next_share(&ledger(Some(0.5)), 0.0), 0.375);
        near(next_share(&ledger(None), 0.06), 0.4 / 2_f64.sqrt());
        near(next_share(&ledger(None), 3.0), 0.2);
        near(next_share(&ledger(None), 0.031), 0.36);
    }
}
