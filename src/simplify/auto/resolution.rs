//! How large photographs are: of half the size as long as the detail that halving loses is next to nothing of what is
//! wrong with the scene.
//!
//! What halving loses, a mean squared error, is measured in the photographs themselves. Where that is nothing to speak
//! of even beside the least error that counts, half the size does for all steps but the last fit. Otherwise whole
//! photographs are due once the scene is so good that what halving loses begins to tell; a scene full of detail may
//! begin with them.

use super::{CountController, view_options};
use crate::Result;
use crate::simplify::detail::lost_by_halving;
use crate::simplify::gain::error;
use crate::simplify::held_out::{self, split_views};
use crate::simplify::history::{Act, Entry};
use crate::train::Trainer;

impl<'a> CountController<'a> {
    /// Begins with photographs of half the size, unless those would do for no step.
    pub(super) fn begin_size(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let (_, held) = split_views(self.dataset, &self.history.config);
        let background = view_options(trainer).background;
        self.history.lost_by_halving = lost_by_halving(self.dataset, &held, background)?;
        let scores = held_out::psnr_db(
            &mut self.held_out,
            &trainer.splats()?,
            self.history.config.full_db,
        )?;
        self.history.is_half = true;
        self.history.is_half = !self.is_detail_missed(&scores);
        trainer.set_half_size(self.history.is_half)
    }

    /// Before growth begins: goes over to whole photographs if it is time, as often as is looked at growth.
    pub(super) fn after_first_steps(
        &mut self,
        trainer: &mut Trainer<'a>,
        iteration: u32,
    ) -> Result<()> {
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

    /// Goes over to whole photographs, from how the scene is now.
    pub(super) fn enlarge(&mut self, trainer: &mut Trainer<'a>, now: &Entry) -> Result<()> {
        self.history.is_half = false;
        self.history.entries.push(Entry {
            act: Act::Enlarged,
            ..now.clone()
        });
        trainer.set_half_size(false)
    }

    /// Whether what halving loses will be missed sooner or later.
    pub(super) fn is_detail_hidden(&self) -> bool {
        let config = &self.history.config;
        let hidden = config.half_size_hidden * config.invisible_error();
        self.history.is_half && self.history.lost_by_halving > hidden
    }

    /// Whether a scene that has such scores is held back by it.
    pub(super) fn is_detail_missed(&self, scores: &[f64]) -> bool {
        self.is_detail_hidden()
            && self.history.lost_by_halving > self.history.config.half_size_missed * error(scores)
    }
}
