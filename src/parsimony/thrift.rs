//! Training to no more splats than a scene needs: what is done between two steps of a run, from growth to the last fit.
//!
//! Splats are added as the strategy has it. Growth ends when the lower bound of what it gives some training views, for a
//! tenth more splats, is under the preference; all that their scores have risen counts as its gain, though time has its
//! share in that, so that growth never ends too soon. From then on those views are held out; not before, since
//! what they alone saw would be missing from the scene. The
//! splats of least weight go, a share of them in every round. A round takes the same steps from the same state twice,
//! without those splats and with them, since scores rise with time as well; they go for good where the held-out views lose
//! no more by it than they are worth by the preference, and otherwise a smaller share is tried. Last, the held-out views
//! return.
//!
//! **Invariant:** what happens is a function of configuration, preference, views and device, and what it goes by beside
//! the trainer's state is in the [`Ledger`] and the state kept: a resumed run decides alike.

use super::gain::{differences, estimate, mean, tenths};
use super::harmonics::reduce_harmonics;
use super::judge::{Judge, part};
use super::ledger::{Act, Entry, Ledger, Phase, Round};
use super::weigher::{Lens, Weigher, Weight};
use crate::render::{Compatibility, ViewOptions};
use crate::scene::{Camera, Dataset, Splats};
use crate::train::schedule::is_refine;
use crate::train::{Background, HostState, TrainConfig, Trainer};
use crate::{Error, Result};

/// The preference where none is given: decibels for a tenth more splats. A first guess from single runs, of which no
/// record is kept; repeated experiments have to settle it.
pub const PREFERENCE_DB: f64 = 0.04;

/// The share of splats that a round takes out.
const SHARE: f64 = 0.25;

/// Rounds that cost less than half of what they might make the next one twice as bold, up to this share.
const SHARE_MAX: f64 = 0.5;

/// Rounds stop at this share: what one of so few is worth cannot be told from chance.
const SHARE_MIN: f64 = 0.1;

/// Looks whose rise together tells what growth gives.
const LOOKS: usize = 3;

/// Growth that has added less than this many tenths over those looks has ended by itself.
const TENTHS_MIN: f64 = 0.5;

/// Errors of colours that leaving out harmonics is tried with.
const SH_ERRORS: [f64; 6] = [
    1.0 / 256.0,
    1.0 / 128.0,
    1.0 / 64.0,
    1.0 / 32.0,
    1.0 / 16.0,
    1.0 / 8.0,
];

/// Steers a run.
pub struct Thrift<'a> {
    dataset: &'a Dataset,
    ledger: Ledger,
    /// The other state of a round: the whole one while its first steps are taken, the lesser one while its second are.
    kept: Option<HostState>,
    judge: Judge,
    fitted: Vec<usize>,
}

/// The run's constants where its count is to be found: growth ends at nine twentieths of it at the latest, which leaves
/// three tenths to rounds and a quarter to the last fit.
///
/// In runs of less than half the published length means and harmonics move twice as fast: so short a run does not get
/// to where it is going by the published rates. That helps as much without pruning, so it is no merit of this, and is not
/// settled: single runs, no record.
pub fn thrifty(mut config: TrainConfig) -> TrainConfig {
    config.refine.until = config.refine.until.min(config.iterations / 20 * 9);
    if config.iterations < SHORT {
        let rates = &mut config.rates;
        for rate in [
            &mut rates.mean_start,
            &mut rates.mean_end,
            &mut rates.sh_rest,
        ] {
            *rate *= 2.0;
        }
    }
    config
}

/// Runs of fewer iterations are short: half of the published 30,000.
const SHORT: u32 = 15_000;

impl<'a> Thrift<'a> {
    /// Begins to steer a run that has not begun.
    pub fn begin(
        trainer: &mut Trainer<'a>,
        dataset: &'a Dataset,
        preference_db: f64,
        is_open: bool,
    ) -> Result<Thrift<'a>> {
        let ledger = Ledger {
            preference_db,
            share: SHARE,
            end: trainer.config().iterations,
            is_open,
            ..Ledger::default()
        };
        Thrift::resume(trainer, dataset, ledger, None)
    }

    /// Goes on steering, as a checkpoint has it.
    pub fn resume(
        trainer: &mut Trainer<'a>,
        dataset: &'a Dataset,
        ledger: Ledger,
        kept: Option<HostState>,
    ) -> Result<Thrift<'a>> {
        if !(ledger.preference_db > 0.0 && ledger.preference_db.is_finite()) {
            let text = "the smallest gain worth paying for must be a number of decibels above 0";
            return Err(Error::Config(text.into()));
        }
        let (fitted, held) = part(dataset);
        let judge = Judge::new(trainer.gpu(), dataset, &held, lens_options(trainer))?;
        if matches!(ledger.phase, Phase::Pruning | Phase::Converging) {
            trainer.set_views(fitted.clone())?;
        }
        if ledger.phase != Phase::Growing {
            trainer.set_limit(0);
        }
        Ok(Thrift {
            dataset,
            ledger,
            kept,
            judge,
            fitted,
        })
    }

    /// What has been found so far.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// The other state of the round on its way.
    pub fn kept(&self) -> Option<&HostState> {
        self.kept.as_ref()
    }

    /// Does what there is to do after the trainer's last step.
    pub fn attend(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let iteration = trainer.iteration();
        match self.ledger.phase {
            Phase::Growing => self.attend_growth(trainer, iteration),
            Phase::Pruning => self.attend_round(trainer, iteration),
            Phase::Converging => self.attend_convergence(trainer, iteration),
            Phase::Settled => Ok(()),
        }
    }

    fn attend_growth(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
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
        if is_last || is_enough {
            entry.act = Act::Stopped;
            self.ledger.entries.push(entry);
            self.ledger.phase = Phase::Pruning;
            trainer.set_limit(0);
            trainer.set_views(self.fitted.clone())?;
            return self.begin_round(trainer);
        }
        self.ledger.entries.push(entry);
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

    fn attend_round(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let steps = round(trainer.config());
        let round = match self.ledger.round.take() {
            Some(round) if iteration >= round.from + steps => round,
            waiting => {
                self.ledger.round = waiting;
                return Ok(());
            }
        };
        let entry = self.look(trainer)?;
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
            self.ledger.share /= 2.0;
        } else {
            entry.act = Act::Pruned;
            trainer.replace(less)?;
            if gain.mean < 0.5 * preference {
                self.ledger.share = (2.0 * self.ledger.share).min(SHARE_MAX);
            }
        }
        self.ledger.entries.push(entry);
        let config = trainer.config();
        let is_time = trainer.iteration() + round(config) > settle_by(config);
        match is_time || self.ledger.share < SHARE_MIN {
            true => self.decide(trainer),
            false => self.begin_round(trainer),
        }
    }

    /// The count is decided.
    fn decide(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        self.kept = None;
        self.ledger.phase = Phase::Converging;
        let iteration = trainer.iteration();
        self.attend_convergence(trainer, iteration)
    }

    fn attend_convergence(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let config = trainer.config();
        if !self.ledger.is_open || iteration >= settle_by(config) {
            return self.settle(trainer);
        }
        let window = (config.iterations / 8).clamp(1, 1_000);
        let last = self.ledger.entries.last().map_or(0, |e| e.iteration);
        if iteration < last + window {
            return Ok(());
        }
        let entry = self.look(trainer)?;
        let risen = self
            .ledger
            .entries
            .last()
            .map(|last| differences(&last.psnr_db, &entry.psnr_db));
        let per_thousand = mean(&risen.unwrap_or_default()) * 1000.0 / f64::from(window);
        self.ledger.entries.push(entry);
        match per_thousand < self.ledger.preference_db {
            true => self.settle(trainer),
            false => Ok(()),
        }
    }

    /// Takes the least important splats out, for the steps of a round.
    fn begin_round(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let state = trainer.download()?;
        let weights = self.weigh(trainer)?;
        let left = (state.len() as f64 * (1.0 - self.ledger.share)).ceil() as usize;
        trainer.replace(&state.select(&heaviest(&weights, left)))?;
        self.kept = Some(state);
        self.ledger.round = Some(Round {
            from: trainer.iteration(),
            without: None,
        });
        Ok(())
    }

    fn settle(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let splats = trainer.splats()?;
        self.ledger.sh_error = self.sh_error(&splats)?;
        let reduced = reduce_harmonics(&splats, self.ledger.sh_error);
        trainer.lower_degrees(&reduced.degrees)?;
        self.ledger.phase = Phase::Settled;
        let config = trainer.config();
        self.ledger.end = config
            .iterations
            .min(trainer.iteration() + last_fit(config));
        if !self.ledger.is_open {
            self.ledger.end = config.iterations;
        }
        self.ledger.settled_from = Some(trainer.iteration());
        let all = self.dataset.split(crate::scene::Split::Train);
        trainer.set_views(all)
    }

    /// The largest error of [`SH_ERRORS`] up to which leaving out harmonics loses the held-out views no more than the
    /// preference; 0 if none is.
    fn sh_error(&mut self, splats: &Splats) -> Result<f64> {
        let whole = self.judge.score(splats)?;
        let mut found = 0.0;
        for error in SH_ERRORS {
            let less = self.judge.score(&reduce_harmonics(splats, error).splats)?;
            if mean(&differences(&less, &whole)) > self.ledger.preference_db {
                break;
            }
            found = error;
        }
        Ok(found)
    }

    fn weigh(&self, trainer: &mut Trainer<'a>) -> Result<Vec<Weight>> {
        let splats = trainer.splats()?;
        let options = lens_options(trainer);
        let lens = Lens {
            near: options.near,
            background: options.background,
            compatibility: Compatibility::Engine,
        };
        let mut weigher = Weigher::new(trainer.gpu(), &splats, lens)?;
        let camera = |&view: &usize| self.dataset.views[view].camera;
        let cameras: Vec<Camera> = self.fitted.iter().map(camera).collect();
        let weights = weigher.weights(&cameras, &mut || true)?;
        Ok(weights.unwrap_or_default())
    }

    /// How the scene is now.
    fn look(&mut self, trainer: &mut Trainer<'a>) -> Result<Entry> {
        let splats = trainer.splats()?;
        Ok(Entry {
            iteration: trainer.iteration(),
            act: Act::Looked,
            splats: splats.len(),
            psnr_db: self.judge.score(&splats)?,
            without: None,
            gain_db: None,
        })
    }
}

/// Steps of a round's fit.
fn round(config: &TrainConfig) -> u32 {
    (config.iterations / 20).clamp(25, 500)
}

/// Steps that all training views are seen in, at the end.
fn last_fit(config: &TrainConfig) -> u32 {
    config.iterations / 4
}

/// The iteration from which the count is fixed at the latest.
fn settle_by(config: &TrainConfig) -> u32 {
    config.iterations - last_fit(config)
}

/// How training's pictures are judged.
fn lens_options(trainer: &Trainer<'_>) -> ViewOptions {
    let config = trainer.config();
    ViewOptions {
        background: match config.background {
            Background::Fixed(color) => color,
            Background::Random => [0.0; 3],
        },
        near: trainer.near(),
        mode: config.mode,
    }
}

/// The rows of the splats that weigh most, in their order; of equals the first.
fn heaviest(weights: &[Weight], count: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..weights.len() as u32).collect();
    let weight = |row: u32| weights[row as usize].sum;
    order.sort_unstable_by(|&a, &b| weight(b).total_cmp(&weight(a)).then(a.cmp(&b)));
    order.truncate(count);
    order.sort_unstable();
    order
}
