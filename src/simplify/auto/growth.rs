//! Growth phase: densification weights and the end of growth.

use super::survey::Survey;
use super::{CountController, Phase};
use crate::Result;
use crate::simplify::gain::{differences, estimate, steps_of_ten_percent};
use crate::simplify::history::{Act, HistoryEntry};
use crate::train::schedule::is_refine;
use crate::train::{TrainConfig, Trainer};

impl<'a> CountController<'a> {
    pub(super) fn after_growth_step(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let config = trainer.config();
        let is_last = iteration >= config.refine.until;
        // Evaluate just before a refinement: splats that it adds have not been fitted yet.
        if !is_last && !is_refine(config, iteration + 1) {
            return self.after_first_steps(trainer, iteration);
        }
        // A step that did not fit is run again; its first evaluation must not count twice.
        let last = self.history.entries.last();
        if last.is_some_and(|last| last.iteration == iteration) {
            return Ok(());
        }
        let mut entry = self.look(trainer)?;
        entry.gain_db = self.gain(trainer.config(), &entry);
        let is_enough = match entry.gain_db {
            Some([_, low]) => low < self.history.preference_db,
            None => false,
        };
        let is_full = self.history.config.is_full(&entry.psnr_db);
        // Detail hidden by half-size photographs may be the reason for a low gain; growth then goes on.
        let is_hidden = self.is_detail_hidden();
        let is_over = is_last || is_full || is_enough && !is_hidden;
        let is_missed = is_enough || is_over || self.is_detail_missed(&entry.psnr_db);
        if is_hidden && is_missed {
            self.enlarge(trainer, &entry)?;
        } else if !is_over {
            self.history.entries.push(entry.clone());
        }
        if is_over {
            entry.act = Act::Stopped;
            self.history.entries.push(entry);
            self.history.phase = Phase::Pruning;
            trainer.set_limit(0);
            trainer.set_views(self.fitted.clone())?;
            return match is_full {
                true => self.begin_round_without_sh(trainer, iteration),
                false => self.begin_round(trainer),
            };
        }
        self.set_densify_errors(trainer)
    }

    /// Sets the error share of each splat for the refinement after the next step, if there is one.
    pub(super) fn set_densify_errors(&self, trainer: &mut Trainer<'a>) -> Result<()> {
        let config = trainer.config();
        let next = trainer.iteration() + 1;
        if self.history.phase != Phase::Growing || !is_refine(config, next) {
            return Ok(());
        }
        let turn = (next / config.refine.every) as usize;
        let views = trainer.views().to_vec();
        let errors = Survey::begin(&self.kernels, trainer, self.dataset)?.errors(
            &views,
            self.history.config.error_views as usize,
            turn,
        )?;
        trainer.set_errors(errors);
        Ok(())
    }

    /// Gain of a tenth more splats over the last `growth_refinements` evaluations and its lower bound, decibels. Only
    /// evaluations since the change to full-size photographs count, so that its gain is not attributed to splats.
    fn gain(&self, config: &TrainConfig, now: &HistoryEntry) -> Option<[f64; 2]> {
        let auto = &self.history.config;
        let is_look = |entry: &&HistoryEntry| is_refine(config, entry.iteration + 1);
        let looks: Vec<&HistoryEntry> = self.history.entries.iter().filter(is_look).collect();
        let is_enlarged = |entry: &&HistoryEntry| entry.act == Act::Enlarged;
        let from = looks.iter().rposition(is_enlarged).unwrap_or(0);
        let before = looks[from..].iter().rev().nth(auto.growth_refinements as usize - 1)?;
        let risen = differences(&before.psnr_db, &now.psnr_db);
        let added = steps_of_ten_percent(before.splats, now.splats).max(auto.growth_steps_min);
        let each: Vec<f64> = risen.iter().map(|d| d / added).collect();
        let found = estimate(&each);
        Some([found.mean, found.low])
    }
}
