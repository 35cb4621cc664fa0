//! Resolution of the photographs: half width and height while the detail that halving loses is a small part of the
//! scene's error.
//!
//! The mean squared error of halving is measured on the photographs themselves. If it is small even beside the least
//! error that counts, half size serves all steps but the last fit. Otherwise full size begins once halving makes up a
//! notable part of the scene's error, for detailed scenes possibly at the first step.

use super::{CountController, view_options};
use crate::Result;
use crate::simplify::detail::lost_by_halving;
use crate::simplify::gain::error;
use crate::simplify::held_out::{self, split_views};
use crate::simplify::history::{Act, HistoryEntry};
use crate::train::Trainer;

impl<'a> CountController<'a> {
    /// Sets the initial size: half, unless full size is due at once.
    pub(super) fn begin_size(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let (_, held) = split_views(self.dataset, &self.history.config);
        let background = view_options(trainer).background;
        self.history.lost_by_halving = lost_by_halving(self.dataset, &held, background)?;
        let scores = held_out::psnr_db(&mut self.held_out, &trainer.splats()?, self.history.config.full_db)?;
        self.history.is_half = true;
        self.history.is_half = !self.is_detail_missed(&scores);
        trainer.set_half_size(self.history.is_half)
    }

    /// Changes to full size before growth if due, checked as often as growth evaluates.
    pub(super) fn after_first_steps(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let every = trainer.config().refine.every;
        if !self.is_detail_hidden() || !(iteration + 1).is_multiple_of(every) {
            return Ok(());
        }
        let entry = self.look(trainer)?;
        match self.is_detail_missed(&entry.psnr_db) {
            true => self.enlarge(trainer, &entry),
            false => Ok(()),
        }
    }

    /// Changes to full-size photographs and records `now`, the scene before it.
    pub(super) fn enlarge(&mut self, trainer: &mut Trainer<'a>, now: &HistoryEntry) -> Result<()> {
        self.history.is_half = false;
        self.history.entries.push(HistoryEntry {
            act: Act::Enlarged,
            ..now.clone()
        });
        trainer.set_half_size(false)
    }

    /// Whether halving loses enough that full size will be needed before the last fit.
    pub(super) fn is_detail_hidden(&self) -> bool {
        let config = &self.history.config;
        let hidden = config.half_size_hidden * config.invisible_error();
        self.history.is_half && self.history.lost_by_halving > hidden
    }

    /// Whether halving makes up a notable part of the error of a scene with `scores`, PSNR in decibels.
    pub(super) fn is_detail_missed(&self, scores: &[f64]) -> bool {
        self.is_detail_hidden() && self.history.lost_by_halving > self.history.config.half_size_missed * error(scores)
    }
}
