//! Harmonics where they are needed: those go that the held-out views do not miss; half of them, or a quarter where half is
//! missed, may cost as much as a tenth of the splats. Three quarters of a splat's bytes are harmonics.
//! All that rounds take together may cost no more, beside what goes at once.

use super::rounds::round;
use super::survey::Survey;
use super::{Phase, Thrift, settle_by};
use crate::Result;
use crate::parsimony::colors::{Fits, count};
use crate::parsimony::gain::{differences, mean};
use crate::parsimony::ledger::{Act, Entry, Round};
use crate::render::{degrees_used, merge_degrees};
use crate::scene::Splats;
use crate::train::schedule::sh_degree;
use crate::train::{HostState, Trainer};

/// The shares of the harmonics' floats that may turn out to be enough at once, one after the other; the last is degree 0
/// everywhere.
const SHARES: [f64; 6] = [0.75, 0.5, 0.35, 0.2, 0.1, 1.0 / 16.0];

/// The share of the harmonics that rounds try to do without.
const HALF: f64 = 0.5;

/// That which they try once the other was missed.
const QUARTER: f64 = 0.25;

/// Harmonics that go at once may lose so much of the preference: those that nobody needed.
const AT_ONCE: f64 = 0.5;

/// Views that colours are fitted to, at most.
const VIEWS_MAX: usize = 64;

impl<'a> Thrift<'a> {
    /// Tries to do without any harmonics, where growth has ended because nothing is left to them. Those that have not
    /// been trained yet go in any case.
    pub(super) fn begin_bare(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let degree = sh_degree(trainer.config(), iteration);
        if degree < trainer.config().sh_degree {
            self.ledger.sh_lost_db = Some(0.0);
            trainer.lower_degrees(&vec![degree as u8; trainer.splat_count()])?;
        }
        let splats = trainer.splats()?;
        if splats.sh_degree == 0 {
            return self.begin_round(trainer);
        }
        // Degree 0 everywhere takes three floats a splat.
        match self.try_lowered(trainer, &splats, 3 * splats.len())? {
            Some(round) => {
                round.is_bare = true;
                Ok(())
            }
            None => self.begin_round(trainer),
        }
    }

    pub(super) fn judge_bare(
        &mut self,
        trainer: &mut Trainer<'a>,
        entry: Entry,
        without: (usize, Vec<f64>),
        less: &HostState,
    ) -> Result<()> {
        self.settle_lowering(trainer, entry, without, less)?;
        self.begin_round(trainer)
    }

    /// Takes the harmonics that hardly show, and tries to do without half of the others, or a quarter.
    pub(super) fn begin_lowering(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        self.ledger.phase = Phase::Lowering;
        let splats = trainer.splats()?;
        if splats.sh_degree == 0 {
            return self.decide(trainer);
        }
        let fits = self.fits(trainer, &splats)?;
        let whole = self.judge.score(&splats)?;
        let (gone_before, mut found) = (self.ledger.sh_lost_db, None);
        for share in SHARES {
            let floats = (share * splats.sh.len() as f64) as usize;
            let (degrees, less) = lowered(&fits, &splats, floats);
            let lost = mean(&differences(&self.judge.score(&less)?, &whole));
            if lost > AT_ONCE * self.ledger.preference_db {
                break;
            }
            self.ledger.sh_lost_db = Some(gone_before.unwrap_or(0.0) + lost);
            found = Some((degrees, less));
        }
        if let Some((degrees, less)) = found {
            let state = without(&trainer.download()?, &degrees, &less);
            trainer.replace(&state)?;
        }
        self.ledger.sh_share = HALF;
        self.begin_less(trainer)
    }

    /// Tries to do without a share of the harmonics, if there is time and there are any.
    fn begin_less(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let splats = trainer.splats()?;
        let config = trainer.config();
        if splats.sh_degree == 0 || trainer.iteration() + round(config) > settle_by(config) {
            return self.decide(trainer);
        }
        let floats = count(&degrees_used(&splats)) as f64;
        let left = (1.0 - self.ledger.sh_share) * floats;
        match self.try_lowered(trainer, &splats, left as usize)? {
            Some(_) => Ok(()),
            None => self.decide(trainer),
        }
    }

    /// Takes the first steps of a round with about so many floats for harmonics; `None` where none would go: degrees
    /// that few splats have are rounded up.
    fn try_lowered(
        &mut self,
        trainer: &mut Trainer<'a>,
        splats: &Splats,
        floats: usize,
    ) -> Result<Option<&mut Round>> {
        let fits = self.fits(trainer, splats)?;
        let (degrees, less) = lowered(&fits, splats, floats);
        if count(&degrees) >= count(&degrees_used(splats)) {
            return Ok(None);
        }
        let state = trainer.download()?;
        let less = without(&state, &degrees, &less);
        self.try_without(trainer, state, &less).map(Some)
    }

    pub(super) fn judge_lowering(
        &mut self,
        trainer: &mut Trainer<'a>,
        entry: Entry,
        without: (usize, Vec<f64>),
        less: &HostState,
    ) -> Result<()> {
        let is_lowered = self.settle_lowering(trainer, entry, without, less)?;
        if !is_lowered && self.ledger.sh_share == QUARTER {
            return self.decide(trainer);
        }
        if !is_lowered {
            self.ledger.sh_share = QUARTER;
        }
        self.begin_less(trainer)
    }

    /// Goes on without the harmonics of a round if the held-out views do not miss them; says whether.
    fn settle_lowering(
        &mut self,
        trainer: &mut Trainer<'a>,
        mut entry: Entry,
        without: (usize, Vec<f64>),
        less: &HostState,
    ) -> Result<bool> {
        let lost = mean(&differences(&without.1, &entry.psnr_db));
        let all_lost = self.ledger.sh_lost_db.unwrap_or(0.0) + lost;
        let preference = self.ledger.preference_db;
        let is_missed = lost > preference || all_lost > (1.0 + AT_ONCE) * preference;
        entry.without = Some(without);
        entry.act = match is_missed {
            true => Act::LoweredInVain,
            false => Act::Lowered,
        };
        self.ledger.entries.push(entry);
        if !is_missed {
            *self.ledger.sh_lost_db.get_or_insert(0.0) += lost;
            trainer.replace(less)?;
        }
        Ok(!is_missed)
    }

    /// Colours by fewer harmonics, for what the training views see.
    fn fits(&self, trainer: &mut Trainer<'a>, splats: &Splats) -> Result<Fits> {
        let all = self.all();
        let step = all.len().div_ceil(VIEWS_MAX).max(1);
        let views: Vec<usize> = all.into_iter().step_by(step).collect();
        let seen = Survey::begin(trainer, self.dataset)?.seen(&views)?;
        Ok(Fits::new(splats, &seen))
    }
}

/// Degrees that take about so many floats, and the scene with them.
fn lowered(fits: &Fits, splats: &Splats, floats: usize) -> (Vec<u8>, Splats) {
    let mut degrees = fits.degrees(floats);
    merge_degrees(&mut degrees);
    let less = fits.applied(splats, &degrees);
    (degrees, less)
}

fn without(state: &HostState, degrees: &[u8], less: &Splats) -> HostState {
    let mut state = state.clone();
    state.recolor(less);
    state.lower_degrees(degrees);
    state
}
