//! Control of the splat count during training, between the steps of a run, from growth to the last fit.
//!
//! Splats are added by the strategy for a share of the run, or until no held-out view has a visible error. From then on
//! the held-out views are not trained on; earlier, splats that only they see would be missing.
//!
//! A share of the splats goes in every round: those with the smallest change of the pictures. A round runs the same
//! steps from the same state twice, without those splats and with them, since scores also rise with time.
//! The losses of accepted rounds are summed, by view, in PSNR and in SSIM. The splats stay removed if the sums are
//! within what may be lost in total, by upper bounds over the held-out views: few or scattered views widen the bounds
//! and thereby keep splats. Where these views cannot tell the scenes apart, upper bounds over views trained on decide.
//! A rejected round halves the share of those after it. Last, SH coefficients go that cost the views little, and the
//! held-out views return to training.
//!
//! **Invariant:** decisions are a function of configuration, views and device. Their state beside the trainer's is the
//! [`History`] and the kept state, so that a resumed run decides alike.

mod memory;
mod rounds;
mod sh;
mod survey;

pub use memory::controller_needs;

use super::contribution::Kernels;
use super::held_out::split_views;
use super::history::{Act, History, HistoryEntry, Phase};
use super::loss::ViewScores;
use crate::Result;
use crate::render::{Evaluator, ViewOptions};
use crate::scene::{Dataset, Splats, Split};
use crate::stats::mean;
use crate::train::config::LearningRates;
use crate::train::schedule::is_refine;
use crate::train::{Controller, HostState, Run, TrainConfig, Trainer};
use std::sync::Arc;

/// Controller of the splat count of a run.
pub struct CountController<'a> {
    dataset: &'a Dataset,
    history: History,
    /// Other state of a round: the full one during the first run, the reduced one during the second.
    kept: Option<HostState>,
    /// Evaluator of the held-out views, then of views that are always trained on: one for both, since its buffers stay
    /// on the device.
    evaluator: Evaluator<'a>,
    /// Number of held-out views.
    held_out: usize,
    /// Views trained on while others are held out.
    fitted: Vec<usize>,
    /// Kernels of the surveys: compiling takes longer than most of them.
    kernels: Arc<Kernels>,
}

/// Share of the splats that the first round removes.
const FIRST_SHARE: f64 = 0.5;

/// Largest number of views trained on that are scored, unless more are held out: the bounds over three views are wide,
/// and where held-out views are few, these decide.
const TRAINED_VIEWS: usize = 16;

/// Training run with an optional [`CountController`].
pub type AutoRun<'a> = Run<'a, CountController<'a>>;

/// Training configuration of a run with a count controller: growth ends with its share of the run.
///
/// Where few training views see a point (`views_per_point`, the median), SH gains nothing by larger rates than the
/// published one (`2026-11-22-few-views.csv`), and measures against overfitting act.
pub fn for_auto_count(mut config: TrainConfig, views_per_point: f64) -> TrainConfig {
    config.refine.until = config.refine.until.min(config.auto.growth_until(config.iterations));
    config.coarse_until = config.auto.half_size_until(config.iterations);
    config.coarse_halvings = 1;
    let overfitting_weight = config.auto.overfitting_weight(views_per_point);
    let factor = LearningRates::factor(config.iterations);
    config.rates.sh_rest *= factor.powf(-overfitting_weight) as f32;
    config.against_overfitting(overfitting_weight as f32)
}

impl<'a> CountController<'a> {
    /// Starts the controller of a run at iteration 0. If `is_open`, the run may end on convergence.
    pub fn begin(trainer: &mut Trainer<'a>, dataset: &'a Dataset, is_open: bool) -> Result<CountController<'a>> {
        let history = History {
            share: FIRST_SHARE,
            end: trainer.config().iterations,
            is_open,
            ..History::default()
        };
        CountController::from_history(trainer, dataset, history, None)
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
        let (fitted, held) = split_views(dataset, &history.config);
        let options = view_options(trainer);
        let step = fitted.len().div_ceil(held.len().max(TRAINED_VIEWS));
        let evaluated: Vec<usize> = held.iter().chain(fitted.iter().step_by(step)).copied().collect();
        let evaluator = Evaluator::new(trainer.gpu(), dataset, &evaluated, options).with_photos()?;
        if !matches!(history.phase, Phase::Growing | Phase::Settled) {
            trainer.set_views(fitted.clone())?;
        }
        if history.phase != Phase::Growing {
            trainer.set_limit(0);
        }
        Ok(CountController {
            dataset,
            history,
            kept,
            evaluator,
            held_out: held.len(),
            fitted,
            kernels: Kernels::new(trainer.gpu(), survey::RULES, trainer.config().kind)?,
        })
    }

    /// Keeps all SH, for a comparison with a run that removes it.
    pub fn keep_sh(&mut self) {
        self.history.keeps_sh = true;
    }

    fn after_growth_step(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        let config = trainer.config();
        let is_last = iteration >= config.refine.until;
        // Evaluate just before a refinement: splats that it adds have not been fitted yet.
        if !is_last && !is_refine(config, iteration + 1) {
            return Ok(());
        }
        // A step that did not fit is run again; its first evaluation must not count twice.
        let last = self.history.entries.last();
        if last.is_some_and(|last| last.iteration == iteration) {
            return Ok(());
        }
        let mut entry = self.evaluate(trainer)?;
        if !is_last && !entry.scores.is_full(&self.history.config) {
            self.history.entries.push(entry);
            return Ok(());
        }
        entry.act = Act::GrowthEnded;
        self.history.entries.push(entry);
        self.history.phase = Phase::Pruning;
        trainer.set_limit(0);
        trainer.set_views(self.fitted.clone())?;
        self.next_round(trainer)
    }

    fn after_convergence_step(&mut self, trainer: &mut Trainer<'a>, iteration: u32) -> Result<()> {
        // Two rounds apart.
        let config = trainer.config();
        let window = 2 * config.auto.round(config.iterations);
        if !self.history.is_open || iteration >= config.auto.settle_by(config.iterations) {
            return self.settle(trainer);
        }
        let last = self.history.entries.last();
        if last.is_some_and(|last| iteration < last.iteration + window) {
            return Ok(());
        }
        let before = last.map_or(f64::NEG_INFINITY, |last| mean(&last.scores.psnr_db));
        let entry = self.evaluate(trainer)?;
        let risen = mean(&entry.scores.psnr_db) - before;
        self.history.entries.push(entry);
        match risen < self.history.config.loss_db {
            true => self.settle(trainer),
            false => Ok(()),
        }
    }

    fn settle(&mut self, trainer: &mut Trainer<'a>) -> Result<()> {
        self.history.phase = Phase::Settled;
        let config = trainer.config();
        if self.history.is_open {
            let last_fit = config.auto.last_fit(config.iterations);
            self.history.end = config.iterations.min(trainer.iteration() + last_fit);
        }
        self.history.settled_from = Some(trainer.iteration());
        self.reduce_sh(trainer)?;
        trainer.set_views(self.all())
    }

    /// All training views, held out or not.
    fn all(&self) -> Vec<usize> {
        self.dataset.split(Split::Train)
    }

    /// Evaluation of the current scene on the held-out views.
    fn evaluate(&mut self, trainer: &mut Trainer<'a>) -> Result<HistoryEntry> {
        let splats = trainer.splats()?;
        let [scores, _] = self.scores(&splats)?;
        Ok(HistoryEntry {
            iteration: trainer.iteration(),
            splats: splats.len(),
            scores,
            ..HistoryEntry::default()
        })
    }

    /// Scores of the held-out views and of views trained on.
    fn scores(&mut self, splats: &Splats) -> Result<[ViewScores; 2]> {
        let mut held_out = ViewScores::of(&mut self.evaluator, splats, &self.history.config)?;
        let trained = held_out.split_off(self.held_out);
        Ok([held_out, trained])
    }
}

impl<'a> Controller<'a> for CountController<'a> {
    const NAME: &'static str = "count";
    const VERSION: u32 = 2;
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
            Phase::Pruning => self.after_round_step(trainer, iteration),
            Phase::Converging => self.after_convergence_step(trainer, iteration),
            Phase::Settled => Ok(()),
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
