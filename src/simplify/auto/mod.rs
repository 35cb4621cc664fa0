//! Training to no more splats than a scene needs: what is done between two steps of a run, from growth to the last fit.
//!
//! Splats are added as the strategy has it, more of them where errors are. Growth ends when the lower bound of what it
//! gives some training views, for a tenth more splats, is under the preference; all that their scores have risen counts
//! as its gain, though time has its share in that, so that growth never ends too soon. From then on those views are
//! held out; not before, since what they alone saw would be missing from the scene.
//!
//! A share of the splats goes in every round: those without which the pictures would change least, or by merging. A
//! round takes the same steps from the same state twice, without those splats and with them, since scores rise with
//! time as well; they go for good where the held-out views lose no more by it than they are worth by the preference,
//! and otherwise a smaller share is tried. What the first steps tell for certain needs no second ones. Three counts
//! that were seen show the law that quality follows; from then on rounds aim at its knee, where a tenth more splats is
//! worth just the preference. Then a round shows by the same rule how many harmonics can go; all of them go first where
//! growth has ended for want of anything to gain. Last, the held-out views return, and harmonics go when it is known
//! best which.
//!
//! **Invariant:** what happens is a function of configuration, preference, views and device, and what it goes by beside
//! the trainer's state is in the [`History`] and the state kept: a resumed run decides alike.

mod candidate;
mod growth;
mod resolution;
mod rounds;
mod sh_rounds;
mod survey;

use super::contribution::ContributionPass;
use super::gain::differences;
use super::held_out::{self, split_views};
use super::history::{Act, Entry, History, Phase};
use crate::render::{Evaluator, ViewOptions};
use crate::scene::{Dataset, Split};
use crate::stats::mean;
use crate::train::{Controller, HostState, Run, TrainConfig, Trainer};
use crate::{Error, Result};

/// Steers a run.
pub struct CountController<'a> {
    dataset: &'a Dataset,
    history: History,
    /// The other state of a round: the whole one while its first steps are taken, the lesser one while its second are.
    kept: Option<HostState>,
    /// Evaluator of the held-out views.
    held_out: Evaluator<'a>,
    /// Evaluator of about as many views that are trained on.
    trained: Evaluator<'a>,
    /// Views trained on while others are held out.
    fitted: Vec<usize>,
    /// Held for its kernels alone, which every survey shares.
    _idle: ContributionPass,
}

/// Training run with an optional [`CountController`].
pub type AutoRun<'a> = Run<'a, CountController<'a>>;

/// The run's constants where its count is to be found: growth ends at nine twentieths of it at the latest, which leaves
/// a quarter to rounds without splats, a twentieth to one without harmonics (or splats, where no harmonics are left)
/// and a quarter to the last fit.
///
/// In runs of less than half the published length means and harmonics move twice as fast: so short a run does not
/// get to where it is going by the published rates. That helps without pruning, too, so it is no merit of this, and
/// not everywhere (`2026-11-22-needs-rates.csv`: the fox +0.66 to +0.97 dB, the sphere -0.43 dB). From few training
/// views, `views` of them, harmonics gain nothing by it (`2026-11-22-few-views.csv`), and keep the published rate.
pub fn for_auto_count(mut config: TrainConfig, views: usize) -> TrainConfig {
    config.refine.until = config
        .refine
        .until
        .min(config.auto.growth_until(config.iterations));
    if config.iterations < config.auto.short_iterations {
        let (rates, factor) = (&mut config.rates, config.auto.short_rate_factor);
        rates.mean_start *= factor;
        rates.mean_end *= factor;
        if views >= config.auto.sh_rate_views as usize {
            rates.sh_rest *= factor;
        }
    }
    config
}

impl<'a> CountController<'a> {
    /// Begins to steer a run that has not begun.
    pub fn begin(
        trainer: &mut Trainer<'a>,
        dataset: &'a Dataset,
        is_open: bool,
    ) -> Result<CountController<'a>> {
        let config = &trainer.config().auto;
        let history = History {
            preference_db: config.preference_db,
            share: config.share_first,
            end: trainer.config().iterations,
            is_open,
            ..History::default()
        };
        let mut controller = CountController::from_history(trainer, dataset, history, None)?;
        controller.begin_size(trainer)?;
        Ok(controller)
    }

    /// What has been found so far.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Controller in the state that a history and a kept scene state describe.
    fn from_history(
        trainer: &mut Trainer<'a>,
        dataset: &'a Dataset,
        mut history: History,
        kept: Option<HostState>,
    ) -> Result<CountController<'a>> {
        history.config = trainer.config().auto;
        if !(history.preference_db > 0.0 && history.preference_db.is_finite()) {
            let text = "the smallest gain worth paying for must be a number of decibels above 0";
            return Err(Error::Config(text.into()));
        }
        let (fitted, held) = split_views(dataset, &history.config);
        let options = view_options(trainer);
        let held_out = Evaluator::new(trainer.gpu(), dataset, &held, options).with_photos()?;
        let step = fitted.len().div_ceil(held.len()).max(1);
        let own: Vec<usize> = fitted.iter().copied().step_by(step).collect();
        let trained = Evaluator::new(trainer.gpu(), dataset, &own, options).with_photos()?;
        if !matches!(history.phase, Phase::Growing | Phase::Settled) {
            trainer.set_views(fitted.clone())?;
        }
        if history.phase != Phase::Growing {
            trainer.set_limit(0);
        }
        trainer.set_half_size(history.is_half)?;
        let controller = CountController {
            dataset,
            history,
            kept,
            held_out,
            trained,
            fitted,
            _idle: survey::idle(trainer)?,
        };
        controller.set_densify_errors(trainer)?;
        Ok(controller)
    }

    /// Lets no harmonics go: what those are worth that would have gone shows beside a run that lets them.
    pub fn keep_sh(&mut self) {
        self.history.keeps_sh = true;
    }

    /// The count is decided.
    fn decide(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        self.kept = None;
        self.history.phase = Phase::Converging;
        let iteration = trainer.iteration();
        self.after_convergence_step(trainer, iteration)
    }

    fn after_convergence_step(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let config = trainer.config();
        if !self.history.is_open || iteration >= config.auto.settle_by(config.iterations) {
            return self.settle(trainer);
        }
        let window = config.auto.convergence_steps(config.iterations);
        let last = self.history.entries.last().map_or(0, |e| e.iteration);
        if iteration < last + window {
            return Ok(());
        }
        let entry = self.look(trainer)?;
        let risen = self
            .history
            .entries
            .last()
            .map(|last| differences(&last.psnr_db, &entry.psnr_db));
        let per_thousand = mean(&risen.unwrap_or_default()) * 1000.0 / f64::from(window);
        self.history.entries.push(entry);
        match per_thousand < self.history.preference_db {
            true => self.settle(trainer),
            false => Ok(()),
        }
    }

    fn settle(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        self.history.phase = Phase::Settled;
        let config = trainer.config();
        self.history.end = config
            .iterations
            .min(trainer.iteration() + config.auto.last_fit(config.iterations));
        if !self.history.is_open {
            self.history.end = config.iterations;
        }
        self.history.settled_from = Some(trainer.iteration());
        if self.history.is_half {
            let entry = self.look(trainer)?;
            self.enlarge(trainer, &entry)?;
        }
        trainer.set_views(self.all())
    }

    /// All training views, held out or not.
    fn all(&self) -> Vec<usize> {
        self.dataset.split(Split::Train)
    }

    /// How the scene is now.
    fn look(&mut self, trainer: &mut Trainer<'a>) -> Result<Entry> {
        let splats = trainer.splats()?;
        Ok(Entry {
            iteration: trainer.iteration(),
            act: Act::Looked,
            splats: splats.len(),
            psnr_db: held_out::psnr_db(&mut self.held_out, &splats, self.history.config.full_db)?,
            without: None,
            gain_db: None,
            lost_db: 0.0,
            is_merged: false,
        })
    }
}

impl<'a> Controller<'a> for CountController<'a> {
    const NAME: &'static str = "count";
    const VERSION: u32 = 1;
    type State = History;

    fn resume(
        trainer: &mut Trainer<'a>,
        dataset: &'a Dataset,
        history: History,
        kept: Option<HostState>,
    ) -> Result<CountController<'a>> {
        CountController::from_history(trainer, dataset, history, kept)
    }

    fn after_step(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        let iteration = trainer.iteration();
        match self.history.phase {
            Phase::Growing => self.after_growth_step(trainer, iteration),
            Phase::Pruning | Phase::Lowering => self.after_round_step(trainer, iteration),
            Phase::Converging => self.after_convergence_step(trainer, iteration),
            Phase::Settled => self.after_last_fit_step(trainer, iteration),
        }
    }

    fn end(&self) -> u32 {
        self.history.end
    }

    fn state(&self) -> &History {
        &self.history
    }

    fn kept(&self) -> Option<&HostState> {
        self.kept.as_ref()
    }
}

/// How training's pictures are judged.
fn view_options(trainer: &Trainer<'_>) -> ViewOptions {
    let config = trainer.config();
    ViewOptions {
        background: config.evaluation_background(),
        near: trainer.near(),
        mode: config.mode,
    }
}
