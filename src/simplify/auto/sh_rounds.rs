//! SH reduction: coefficients without visible effect go at once if they are half of all or more. Otherwise a round
//! tests whether half can go, and if not, another whether a quarter can; either may cost as much as a tenth of the
//! splats. SH takes three quarters of a splat's bytes.
//!
//! Held-out views decide the number of coefficients; the choice of coefficients needs a scene near convergence. So they
//! go in the last fit, and in one step: removed coefficients are fitted into the remaining ones, and the size of a
//! fitted coefficient no longer tells its importance.

use super::survey::Survey;
use super::{CountController, Phase};
use crate::Result;
use crate::render::{apart, degrees_used};
use crate::scene::{Splats, sh_coefficient_count};
use crate::simplify::gain::differences;
use crate::simplify::held_out;
use crate::simplify::history::{Act, HistoryEntry, Round};
use crate::simplify::sh_fit::{Fits, count};
use crate::stats::mean;
use crate::train::schedule::sh_degree;
use crate::train::{HostState, Trainer};

impl<'a> CountController<'a> {
    /// Starts a round without SH, if growth ended on a perfect result. Degrees that have not been trained yet go in any
    /// case.
    pub(super) fn begin_round_without_sh(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let degree = sh_degree(trainer.config(), iteration);
        if degree < trainer.config().sh_degree && !self.history.keeps_sh {
            self.history.sh_lost_db = Some(0.0);
            trainer.lower_degrees(&vec![degree as u8; trainer.splat_count()])?;
        }
        let splats = trainer.splats()?;
        if splats.sh_degree == 0 {
            return self.begin_round(trainer);
        }
        let fits = self.fits(trainer, &splats)?;
        // Degree 0 everywhere takes three floats a splat.
        let (degrees, less) = lowered(&fits, &splats, 3 * splats.len());
        let at_once = held_out::psnr_db(&mut self.held_out, &less, self.history.config.full_db)?;
        let lost = mean(&differences(&at_once, self.history.psnr_db()));
        let config = &self.history.config;
        let is_rejected_at_once = lost > config.sh_all_cost_at_once * config.sh_all_cost * self.history.preference_db;
        let whole = trainer.download()?;
        let less = without(&whole, &degrees, &less);
        let mut round = Round {
            is_without_sh: true,
            ..Round::default()
        };
        let kept = match is_rejected_at_once {
            // Training would not help: the reduced run is over.
            true => {
                round.without = Some((less.len(), at_once));
                less
            }
            false => {
                trainer.replace(&less)?;
                whole
            }
        };
        self.start(trainer, kept, round);
        Ok(())
    }

    pub(super) fn end_round_without_sh(
        &mut self,
        trainer: &mut Trainer<'a>,
        entry: HistoryEntry,
        without: (usize, Vec<f64>),
        less: &HostState,
    ) -> Result<()> {
        if self.could_go(entry, without, self.history.config.sh_all_cost, Act::Lowered) && !self.history.keeps_sh {
            trainer.replace(less)?;
        }
        self.begin_round(trainer)
    }

    /// Removes the SH coefficients without visible effect, or starts a round without half of them.
    pub(super) fn begin_lowering(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        self.history.phase = Phase::Lowering;
        let splats = trainer.splats()?;
        if splats.sh_degree == 0 {
            return self.decide(trainer);
        }
        let fits = self.fits(trainer, &splats)?;
        if self.take_unneeded(trainer, &splats, &fits)? {
            return self.decide(trainer);
        }
        let [share, _] = self.history.config.sh_round_shares;
        self.begin_share(trainer, share, (&splats, &fits))
    }

    /// Removes SH coefficients with hardly any effect, if they are enough; returns whether it did.
    fn take_unneeded(&mut self, trainer: &mut Trainer<'a>, splats: &Splats, fits: &Fits) -> Result<bool> {
        // Scores capped at 40 dB would allow a loss down to that.
        let whole = held_out::psnr_db(&mut self.held_out, splats, f64::INFINITY)?;
        let mut found = None;
        for share in self.history.config.sh_shares {
            let (degrees, less) = lowered(fits, splats, floats(trainer, share));
            let scores = held_out::psnr_db(&mut self.held_out, &less, f64::INFINITY)?;
            let lost = mean(&differences(&scores, &whole));
            if lost > self.history.config.sh_cost_at_once * self.history.preference_db {
                break;
            }
            found = Some((degrees, less, lost));
        }
        let Some((degrees, less, lost)) = found else {
            return Ok(false);
        };
        *self.history.sh_lost_db.get_or_insert(0.0) += lost;
        if !self.history.keeps_sh {
            let state = without(&trainer.download()?, &degrees, &less);
            trainer.replace(&state)?;
        }
        Ok(true)
    }

    /// Starts a round without `share` of the SH floats, if there is time and there are so many.
    fn begin_share(&mut self, trainer: &mut Trainer<'a>, share: f64, (splats, fits): (&Splats, &Fits)) -> Result<()> {
        let left = floats(trainer, 1.0 - share);
        if !has_time(trainer) || count(&degrees_used(splats)) <= left {
            return self.decide(trainer);
        }
        self.history.sh_share = share;
        let (degrees, less) = lowered(fits, splats, left);
        let state = trainer.download()?;
        trainer.replace(&without(&state, &degrees, &less))?;
        self.start(trainer, state, Round::default());
        Ok(())
    }

    pub(super) fn end_lowering_round(
        &mut self,
        trainer: &mut Trainer<'a>,
        entry: HistoryEntry,
        without: (usize, Vec<f64>),
    ) -> Result<()> {
        let share = self.history.sh_share;
        if self.could_go(entry, without, 1.0, Act::Dispensable) {
            self.history.sh_goes = Some(share);
            return self.decide(trainer);
        }
        let [_, second] = self.history.config.sh_round_shares;
        if share == second || !has_time(trainer) {
            return self.decide(trainer);
        }
        let splats = trainer.splats()?;
        let fits = self.fits(trainer, &splats)?;
        self.begin_share(trainer, second, (&splats, &fits))
    }

    /// Whether the held-out views lose no more by the SH reduction than `preferences` times the preference; records the
    /// round, with `act` if so.
    fn could_go(&mut self, mut entry: HistoryEntry, without: (usize, Vec<f64>), preferences: f64, act: Act) -> bool {
        let lost = mean(&differences(&without.1, &entry.psnr_db));
        let is_missed = lost > preferences * self.history.preference_db;
        entry.without = Some(without);
        entry.act = match is_missed {
            true => Act::Indispensable,
            false => act,
        };
        self.history.entries.push(entry);
        if !is_missed {
            *self.history.sh_lost_db.get_or_insert(0.0) += lost;
        }
        !is_missed
    }

    /// Removes the SH share that a round found dispensable, once the last fit is far enough.
    pub(super) fn after_last_fit_step(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let config = trainer.config();
        let left = (f64::from(config.auto.last_fit(config.iterations)) * config.auto.sh_fit_left) as u32;
        if iteration + left < self.history.end {
            return Ok(());
        }
        let share = self.history.sh_goes.take();
        let Some(share) = share.filter(|_| !self.history.keeps_sh) else {
            return Ok(());
        };
        let mut entry = self.look(trainer)?;
        let splats = trainer.splats()?;
        let fits = self.fits(trainer, &splats)?;
        let (degrees, less) = lowered(&fits, &splats, floats(trainer, 1.0 - share));
        entry.act = Act::Lowered;
        entry.without = Some((
            less.len(),
            held_out::psnr_db(&mut self.held_out, &less, self.history.config.full_db)?,
        ));
        self.history.entries.push(entry);
        let state = without(&trainer.download()?, &degrees, &less);
        trainer.replace(&state)
    }

    /// Fits of lower SH degrees to the training views.
    fn fits(&self, trainer: &mut Trainer<'a>, splats: &Splats) -> Result<Fits> {
        let all = self.all();
        let step = all.len().div_ceil(self.history.config.sh_fit_views as usize).max(1);
        let views: Vec<usize> = all.into_iter().step_by(step).collect();
        let seen = Survey::begin(&self.kernels, trainer, self.dataset)?.seen(&views)?;
        Ok(Fits::new(splats, &seen))
    }
}

/// Whether there is time for one more round.
fn has_time(trainer: &Trainer<'_>) -> bool {
    let config = trainer.config();
    trainer.iteration() + config.auto.round(config.iterations) <= config.auto.settle_by(config.iterations)
}

/// `share` of the floats of full SH for all splats.
fn floats(trainer: &Trainer<'_>, share: f64) -> usize {
    let of_each = 3 * sh_coefficient_count(trainer.config().sh_degree);
    (share * (of_each * trainer.splat_count()) as f64) as usize
}

/// SH degrees that take at most `floats` floats, and the scene with them.
fn lowered(fits: &Fits, splats: &Splats, floats: usize) -> (Vec<u8>, Splats) {
    let degrees = fits.degrees(floats, apart(splats.len()));
    let less = fits.applied(splats, &degrees);
    (degrees, less)
}

fn without(state: &HostState, degrees: &[u8], less: &Splats) -> HostState {
    let mut state = state.clone();
    state.recolor(less);
    state.lower_degrees(degrees);
    state
}
