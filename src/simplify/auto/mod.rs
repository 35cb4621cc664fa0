//! Control of the splat count during training, between the steps of a run, from growth to the last fit.
//!
//! Splats are added by the strategy, more of them where errors are. Growth ends when the lower bound of its gain on
//! some training views, for a tenth more splats, is below the preference. The whole rise of their scores counts as
//! gain, though training time has its share in it, so that growth never ends too early. From then on those views are
//! held out; earlier, splats that only they see would be missing.
//!
//! A share of the splats goes in every round: those with the smallest change of the pictures, or by merging. A round
//! runs the same steps from the same state twice, without those splats and with them, since scores also rise with time.
//! The splats stay removed if the held-out views lose no more than the preference allows; otherwise a smaller share is
//! tried. The second run is skipped where the first alone proves that the loss is allowed. Three measured counts give
//! the law of quality over splats; further rounds aim at its knee, where a tenth more splats is worth the preference. A
//! round then decides by the same rule how many SH coefficients can go; if growth ended because every held-out view was
//! perfect, a round without any SH comes first. Last, the held-out views return to training, and SH coefficients go
//! when their fit is most reliable.
//!
//! **Invariant:** decisions are a function of configuration, preference, views and device. Their state beside the
//! trainer's is the [`History`] and the kept state, so that a resumed run decides alike.

mod candidate;
mod growth;
mod resolution;
mod rounds;
mod sh_rounds;
mod survey;

use super::contribution::Kernels;
use super::gain::differences;
use super::held_out::{self, split_views};
use super::history::{History, HistoryEntry, Phase};
use crate::render::{Evaluator, ViewOptions};
use crate::scene::{Dataset, Split};
use crate::stats::mean;
use crate::train::{Controller, HostState, Run, TrainConfig, Trainer};
use crate::{Error, Result};
use std::sync::Arc;

/// Controller of the splat count of a run.
pub struct CountController<'a> {
    dataset: &'a Dataset,
    history: History,
    /// Other state of a round: the full one during the first run, the reduced one during the second.
    kept: Option<HostState>,
    /// Evaluator of the held-out views.
    held_out: Evaluator<'a>,
    /// Evaluator of about as many views that are always trained on.
    trained: Evaluator<'a>,
    /// Views trained on while others are held out.
    fitted: Vec<usize>,
    /// Kernels of the surveys: compiling takes longer than most of them.
    kernels: Arc<Kernels>,
}

/// Training run with an optional [`CountController`].
pub type AutoRun<'a> = Run<'a, CountController<'a>>;

/// Training configuration of a run with a count controller. Growth ends after 9/20 of the run at the latest, which
/// leaves 1/4 to rounds without splats, 1/20 to one without SH (or splats, if there is no SH) and 1/4 to the last fit.
///
/// Runs shorter than half the published length use twice the rates for means and SH: at the published rates they end
/// before convergence. That helps without pruning, too, and not everywhere (`2026-11-22-needs-rates.csv`: fox +0.66 to
/// +0.97 dB, sphere −0.43 dB). With few training views (`views`), SH gains nothing (`2026-11-22-few-views.csv`) and
/// keeps the published rate.
pub fn for_auto_count(mut config: TrainConfig, views: usize) -> TrainConfig {
    config.refine.until = config.refine.until.min(config.auto.growth_until(config.iterations));
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
    /// Starts the controller of a run at iteration 0. If `is_open`, the run may end on convergence.
    pub fn begin(trainer: &mut Trainer<'a>, dataset: &'a Dataset, is_open: bool) -> Result<CountController<'a>> {
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

    /// Decisions and their state so far.
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
            kernels: Kernels::new(trainer.gpu(), survey::RULES)?,
        };
        controller.set_densify_errors(trainer)?;
        Ok(controller)
    }

    /// Keeps all SH, for a comparison with a run that removes it.
    pub fn keep_sh(&mut self) {
        self.history.keeps_sh = true;
    }

    /// Ends the rounds: the count is fixed.
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

    /// Evaluation of the current scene on the held-out views.
    fn look(&mut self, trainer: &mut Trainer<'a>) -> Result<HistoryEntry> {
        let splats = trainer.splats()?;
        Ok(HistoryEntry {
            iteration: trainer.iteration(),
            splats: splats.len(),
            psnr_db: held_out::psnr_db(&mut self.held_out, &splats, self.history.config.full_db)?,
            ..HistoryEntry::default()
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

/// View options of training's own evaluation.
fn view_options(trainer: &Trainer<'_>) -> ViewOptions {
    let config = trainer.config();
    ViewOptions {
        background: config.evaluation_background(),
        near: trainer.near(),
        filter: config.filter,
    }
}
