//! Growth: where it goes, and when it ends.

use super::survey::Survey;
use super::{Phase, Thrift};
use crate::Result;
use crate::parsimony::gain::{differences, estimate, tenths};
use crate::parsimony::judge::FULL_DB;
use crate::parsimony::ledger::{Act, Entry};
use crate::train::Trainer;
use crate::train::schedule::is_refine;

/// Looks whose rise together tells what growth gives.
const LOOKS: usize = 3;

/// Growth that has added less than this many tenths over those looks has ended by itself.
const TENTHS_MIN: f64 = 0.5;

impl<'a> Thrift<'a> {
    pub(super) fn attend_growth(
        &mut self,
        trainer: &mut Trainer<'a>,
        iteration: u32,
    ) -> Result<()> {
        let config = trainer.config();
        let is_last = iteration >= config.refine.until;
        // Before a refinement: what it adds has not been fitted yet.
        if !is_last && !is_refine(config, iteration + 1) {
            return Ok(());
        }
        let mut entry = self.look(trainer)?;
        entry.gain_db = self.gain(&entry);
        let is_enough = match entry.gain_db {
            Some([_, low]) => low < self.ledger.preference_db,
            None => false,
        };
        let is_full = entry.psnr_db.iter().all(|&psnr| psnr >= FULL_DB);
        if is_last || is_enough || is_full {
            entry.act = Act::Stopped;
            self.ledger.entries.push(entry);
            self.ledger.phase = Phase::Pruning;
            trainer.set_limit(0);
            trainer.set_views(self.fitted.clone())?;
            return match is_full {
                true => self.begin_bare(trainer, iteration),
                false => self.begin_round(trainer),
            };
        }
        self.ledger.entries.push(entry);
        self.point_out_errors(trainer)
    }

    /// Tells a refinement that comes next where errors are.
    pub(super) fn point_out_errors(&self, trainer: &mut Trainer<'a>) -> Result<()> {
        let config = trainer.config();
        let next = trainer.iteration() + 1;
        if self.ledger.phase != Phase::Growing || !is_refine(config, next) {
            return Ok(());
        }
        let turn = (next / config.refine.every) as usize;
        let views = trainer.views().to_vec();
        let errors = Survey::begin(trainer, self.dataset)?.errors(&views, turn)?;
        trainer.set_errors(errors);
        Ok(())
    }

    /// What a tenth more splats has given over the last looks, and its lower bound.
    fn gain(&self, now: &Entry) -> Option<[f64; 2]> {
        let before = self.ledger.entries.iter().rev().nth(LOOKS - 1)?;
        let risen = differences(&before.psnr_db, &now.psnr_db);
        let added = tenths(before.splats, now.splats).max(TENTHS_MIN);
        let each: Vec<f64> = risen.iter().map(|d| d / added).collect();
        let found = estimate(&each);
        Some([found.mean, found.low])
    }
}
