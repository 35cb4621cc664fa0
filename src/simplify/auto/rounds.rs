//! Rounds: the same steps from the same state, without the least important splats and with them.

use super::survey::Survey;
use super::{CountController, Phase};
use crate::Result;
use crate::simplify::history::{Act, HistoryEntry, ReducedScene, Round};
use crate::simplify::loss::{QualityLoss, ViewScores, lost};
use crate::train::{HostState, Trainer};

impl<'a> CountController<'a> {
    /// Starts a round: removes a share of the splats for its first run.
    fn begin_round(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let whole = trainer.download()?;
        let left = (whole.len() as f64 * (1.0 - self.history.share)).ceil() as usize;
        // Held-out views are included: splats that only they see would otherwise go first. Only their cameras are used.
        let changes = Survey::begin(&self.kernels, trainer, self.dataset)?.changes(&self.all())?;
        trainer.replace(&whole.select(&largest(&changes, left)))?;
        self.kept = Some(whole);
        self.history.round = Some(Round {
            from: trainer.iteration(),
            without: None,
        });
        Ok(())
    }

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
        let scores = self.scores(&trainer.splats()?)?;
        match (round.without.take(), self.kept.take()) {
            (None, Some(whole)) => {
                let less = trainer.download()?;
                // Without visible error there is nothing to compare.
                if scores.iter().all(|scores| scores.is_full(&self.history.config)) {
                    let without = (less.len(), scores.clone());
                    return self.end_round(trainer, (whole.len(), scores), without, &less);
                }
                round.without = Some((less.len(), scores));
                self.kept = Some(less);
                trainer.go_back(&whole, round.from)?;
                self.history.round = Some(round);
                Ok(())
            }
            (Some(without), Some(less)) => {
                let with = (trainer.splat_count(), scores);
                self.end_round(trainer, with, without, &less)
            }
            // An incomplete checkpoint: the round is over.
            (_, None) => self.end_rounds(trainer),
        }
    }

    /// Decides on a round: `with` and `without` are the splats and scores of the full run and of the reduced one, whose
    /// state is `less`.
    fn end_round(
        &mut self,
        trainer: &mut Trainer<'a>,
        with: (usize, [ViewScores; 2]),
        without: (usize, [ViewScores; 2]),
        less: &HostState,
    ) -> Result<()> {
        let mut lost = lost(&with.1, &without.1, &self.history.lost);
        let loss = QualityLoss::of(&lost);
        let is_allowed = loss.share(&self.history.config).0 <= 1.0;
        if is_allowed {
            trainer.replace(less)?;
            lost.iter_mut().for_each(ViewScores::forget_gains);
            self.history.lost = lost;
        }
        if !is_allowed {
            self.history.share = half_share(self.history.share);
        }
        let ([held_out, _], [without_held_out, _]) = (with.1, without.1);
        self.history.entries.push(HistoryEntry {
            iteration: trainer.iteration(),
            act: if is_allowed { Act::Removed } else { Act::Rejected },
            splats: with.0,
            scores: held_out,
            reduced: Some(ReducedScene {
                splats: without.0,
                scores: without_held_out,
                loss,
            }),
        });
        self.next_round(trainer)
    }

    /// Starts a round if there is time for it and its share is not too small; else the rounds end.
    pub(super) fn next_round(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let config = trainer.config();
        let end = trainer.iteration() + config.auto.round(config.iterations);
        let has_time = end <= config.auto.settle_by(config.iterations);
        match has_time && self.history.share >= config.auto.share_min {
            true => self.begin_round(trainer),
            false => self.end_rounds(trainer),
        }
    }

    /// Ends the rounds: the count is fixed.
    fn end_rounds(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        self.kept = None;
        self.history.phase = Phase::Converging;
        let iteration = trainer.iteration();
        self.after_convergence_step(trainer, iteration)
    }
}

/// Share that leaves as many splats, removed twice, as this one removed once.
fn half_share(share: f64) -> f64 {
    1.0 - (1.0 - share).sqrt()
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
    fn two_half_shares_are_a_share() {
        let left = 1.0 - half_share(0.3);
        assert!((left * left - 0.7).abs() < 1e-12);
    }

    #[test]
    fn the_largest_stay_in_their_order() {
        let numbers = [0.5, 3.0, 0.5, 0.0, 2.0];
        assert_eq!(largest(&numbers, 3), [0, 1, 4]);
        assert_eq!(largest(&numbers, 9), [0, 1, 2, 3, 4]);
        assert!(largest(&[], 2).is_empty());
    }
}
