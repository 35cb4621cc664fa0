//! Rounds: the same steps from the same state without the least important splats, or harmonics, and with them.

use super::{Phase, Thrift, prune_by};
use crate::Result;
use crate::parsimony::gain::{differences, estimate, tenths};
use crate::parsimony::ledger::{Act, Entry, Round};
use crate::train::{HostState, TrainConfig, Trainer};

/// The share of splats that the first round takes out.
pub(super) const SHARE: f64 = 0.5;

/// Rounds that cost less than half of what they might make the next one twice as bold, up to this share, or to three
/// quarters of one that was missed.
const SHARE_MAX: f64 = 0.8;

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
                trainer.go_back(&whole, round.from)?;
                self.ledger.round = Some(Round {
                    without: Some((entry.splats, entry.psnr_db)),
                    ..round
                });
                Ok(())
            }
            (Some(without), Some(less)) if self.ledger.phase == Phase::Lowering => {
                self.judge_lowering(trainer, entry, without, &less)
            }
            (Some(without), Some(less)) => self.judge_round(trainer, entry, without, &less),
            // A checkpoint that lacks what it should hold: the round is over.
            (_, None) => self.decide(trainer),
        }
    }

    /// Compares what the same steps have led to with all splats, `entry`, and without the least important.
    fn judge_round(
        &mut self,
        trainer: &mut Trainer<'a>,
        mut entry: Entry,
        without: (usize, Vec<f64>),
        less: &HostState,
    ) -> Result<()> {
        let gone = tenths(without.0, entry.splats).max(1e-9);
        let lost = differences(&without.1, &entry.psnr_db);
        let each: Vec<f64> = lost.iter().map(|lost| lost / gone).collect();
        let gain = estimate(&each);
        entry.gain_db = Some([gain.mean, gain.low]);
        entry.without = Some(without);
        let preference = self.ledger.preference_db;
        if gain.mean > preference {
            entry.act = Act::Missed;
            self.ledger.missed_share = Some(self.ledger.share);
            self.ledger.share /= 2.0;
        } else {
            entry.act = Act::Pruned;
            trainer.replace(less)?;
            if gain.mean < 0.5 * preference {
                let most = self
                    .ledger
                    .missed_share
                    .map_or(SHARE_MAX, |missed| 0.75 * missed);
                self.ledger.share = (2.0 * self.ledger.share).min(most);
            }
        }
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
        self.try_without(trainer, lesser.whole, &lesser.less, lesser.is_merged)
    }

    /// Takes the first steps of a round from the lesser state.
    pub(super) fn try_without(
        &mut self,
        trainer: &mut Trainer<'a>,
        whole: HostState,
        less: &HostState,
        is_merged: bool,
    ) -> Result<()> {
        trainer.replace(less)?;
        self.kept = Some(whole);
        self.ledger.round = Some(Round {
            from: trainer.iteration(),
            without: None,
            is_merged,
        });
        Ok(())
    }
}

/// Steps of a round's fit.
pub(super) fn round(config: &TrainConfig) -> u32 {
    (config.iterations / 20).clamp(25, 500)
}
