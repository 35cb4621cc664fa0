//! What scenes need, measured: one training run of a survey, from its recipe to the figures that it leaves.
//!
//! The same steps on the same photographs for every recipe; what a recipe differs in stands in [`config`]. Time is that
//! of the steps and of all that is done between them, loading and judging left out. The page is
//! [`report::needs::survey`](crate::lab::survey).
//!
//! **Invariant:** but for times and the date, the same task gives the same run on the same device.

pub use super::scenes::{checksum, made};

use super::{Recipe, Run};
use crate::gpu::{Buffer, Gpu};
use crate::io;
use crate::lab::bench::{CpuClock, record};
use crate::lab::evaluator::{frame_time, held_out};
use crate::metrics::MeanScore;
use crate::render::Model;
use crate::scene::{Dataset, Splats, Split};
use crate::simplify::{AutoRun, CountController, History, for_auto_count, reduce_harmonics};
use crate::train::config::LearningRates;
use crate::train::{StrategyKind, TrainConfig, Trainer};
use crate::{Error, Result};
use std::path::Path;
use std::time::Instant;

/// Steps that [`Task::warm_up`] takes.
const WARM_UP: u32 = 3;

/// A run that is to be.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// What the scene is called.
    pub scene: &'a str,
    /// Its photographs; some must be held out.
    pub dataset: &'a Dataset,
    /// How it is trained.
    pub recipe: Recipe,
    /// The seed of all random numbers.
    pub seed: u64,
    /// Steps.
    pub iterations: u32,
    /// The smallest gain worth paying for, decibels for a tenth more splats.
    pub gain_db: f64,
    /// Splats that MCMC may have.
    pub max_splats: Option<u32>,
}

/// The constants of a run with so many training views. MCMC has its cap yet to be told.
pub fn config(recipe: Recipe, iterations: u32, views: usize) -> TrainConfig {
    let usual = TrainConfig::for_iterations(iterations);
    let at_rates_of = |rates: LearningRates, config: TrainConfig| TrainConfig { rates, ..config };
    let for_auto_count = for_auto_count(usual.clone(), views);
    match recipe {
        Recipe::Fixed => usual,
        Recipe::FixedRates => at_rates_of(for_auto_count.rates, usual),
        Recipe::Parsimony | Recipe::ParsimonyAllSh => for_auto_count,
        Recipe::Mcmc => usual.with_strategy(StrategyKind::Mcmc),
        Recipe::McmcRates => at_rates_of(
            for_auto_count.rates,
            usual.with_strategy(StrategyKind::Mcmc),
        ),
    }
}

/// The recipes that differ at this length: where runs to a scene's needs have the usual rates, there is nothing to
/// compare at the same ones.
pub fn recipes(iterations: u32) -> Vec<Recipe> {
    let is_usual = |rates: Recipe, usual: Recipe| {
        // What differs with few views differs with more, too.
        let [rates, usual] =
            [rates, usual].map(|recipe| config(recipe, iterations, usize::MAX).rates);
        rates == usual
    };
    let differs = |recipe: &Recipe| match recipe {
        Recipe::FixedRates => !is_usual(*recipe, Recipe::Fixed),
        Recipe::McmcRates => !is_usual(*recipe, Recipe::Mcmc),
        _ => true,
    };
    Recipe::ALL.into_iter().filter(differs).collect()
}

impl Task<'_> {
    /// All constants of the run.
    fn config(&self) -> TrainConfig {
        let views = self.dataset.split(Split::Train).len();
        let mut config = config(self.recipe, self.iterations, views);
        config.seed = self.seed;
        config.max_splats = self.max_splats;
        config.auto.preference_db = self.gain_db;
        config
    }

    /// The run as far as it is known before it begins.
    pub fn planned(&self, gpu: &Gpu) -> Run {
        let count = |split| self.dataset.split(split).len();
        let first = self.dataset.views.first().map(|view| view.camera);
        Run {
            scene: self.scene.into(),
            recipe: self.recipe,
            seed: self.seed,
            iterations: self.iterations,
            gain_db: self.gain_db,
            max_splats: self.max_splats,
            train_views: count(Split::Train),
            test_views: count(Split::Test),
            width: first.map_or(0, |camera| camera.width),
            height: first.map_or(0, |camera| camera.height),
            data: checksum(self.dataset),
            device: record::slug(&gpu.caps().name),
            version: env!("CARGO_PKG_VERSION").into(),
            ..Run::default()
        }
    }

    /// Takes a few steps that nobody counts: a device may compile kernels where they are first used, and the first run of
    /// all would pay for it.
    pub fn warm_up(&self, gpu: &Gpu) -> Result<()> {
        let mut trainer = Trainer::new(gpu, self.dataset, self.config())?;
        while trainer.iteration() < WARM_UP && !trainer.is_done() {
            trainer.step()?;
        }
        trainer.finish().map(|_| ())
    }

    /// Trains and judges; `progress` hears of every step, and ends the run by saying `false`: then nothing comes of it.
    /// The scene's file is written in `folder` for its size, and removed.
    ///
    /// # Errors
    /// Those of the device, of photographs that cannot be read, and of a folder that cannot be written to.
    pub fn run(
        &self,
        gpu: &Gpu,
        folder: &Path,
        progress: &mut dyn FnMut(u32) -> bool,
    ) -> Result<Option<Run>> {
        let mut evaluator = held_out(gpu, self.dataset)?;
        let Some(trained) = self.train(gpu, progress)? else {
            return Ok(None);
        };
        let Trained {
            splats, history, ..
        } = &trained;
        let score = MeanScore::of(&evaluator.scores(splats)?);
        let model = Model::upload(gpu, splats)?;
        let frame = frame_time(gpu, self.dataset, splats, &model)?;
        let reduced = reduce_harmonics(splats, 0.0);
        let law = history.as_ref().and_then(History::law);
        let points = history.as_ref().map(History::points).unwrap_or_default();
        Ok(Some(Run {
            date: record::today(),
            splats: splats.len(),
            splats_by_degree: reduced.count_from_degree.to_vec(),
            psnr_db: score.psnr_db,
            ssim: score.ssim,
            train_seconds: trained.seconds,
            cpu_seconds: trained.cpu_seconds,
            ply_bytes: file_bytes(folder, splats)?,
            device_bytes_by_degree: device_bytes(&model),
            sh_floats: reduced.floats,
            frame_ms: frame.device_ms,
            frame_cpu_ms: frame.cpu_ms,
            settled_from: history.as_ref().and_then(|history| history.settled_from),
            sh_lost_db: history.as_ref().and_then(|history| history.sh_lost_db),
            knee: law.map(|law| law.knee(self.gain_db)),
            law: law.map_or(Vec::new(), |law| {
                vec![law.limit_db, law.factor, law.exponent]
            }),
            point_splats: points.iter().map(|point| point[0]).collect(),
            point_db: points.iter().map(|point| point[1]).collect(),
            ..self.planned(gpu)
        }))
    }

    fn train(&self, gpu: &Gpu, progress: &mut dyn FnMut(u32) -> bool) -> Result<Option<Trained>> {
        let mut run = AutoRun::new(gpu, self.dataset, self.config())?;
        let (start, clock) = (Instant::now(), CpuClock::now());
        if matches!(self.recipe, Recipe::Parsimony | Recipe::ParsimonyAllSh) {
            run = run.controlled(|trainer, dataset| {
                let mut controller = CountController::begin(trainer, dataset, false)?;
                if self.recipe == Recipe::ParsimonyAllSh {
                    controller.keep_sh();
                }
                Ok(controller)
            })?;
        }
        while !run.is_done() {
            if !progress(run.iteration()) {
                return Ok(None);
            }
            run.step()?;
        }
        run.finish()?;
        Ok(Some(Trained {
            seconds: start.elapsed().as_secs_f64(),
            cpu_seconds: clock.elapsed_ns().map(|ns| 1e-9 * ns),
            history: run
                .controller()
                .map(|controller| controller.history().clone()),
            splats: run.splats()?,
        }))
    }
}

/// What a run has made.
struct Trained {
    splats: Splats,
    history: Option<History>,
    seconds: f64,
    cpu_seconds: Option<f64>,
}

/// Bytes of the scene's file, as it is written.
fn file_bytes(folder: &Path, splats: &Splats) -> Result<u64> {
    let path = folder.join("needs.ply");
    io::ply::write(&path, splats)?;
    let bytes = std::fs::metadata(&path).map(|file| file.len());
    let bytes = bytes.map_err(Error::io(&path))?;
    std::fs::remove_file(&path).map_err(Error::io(&path))?;
    Ok(bytes)
}

/// What splats stored at each degree take on the device.
fn device_bytes(model: &Model) -> Vec<u64> {
    let mut bytes = vec![0; 4];
    for block in model.blocks.of(model.counts) {
        let index = model.splat_from_slot.get(block.index);
        bytes[block.degree as usize] +=
            model.params[block.index].bytes() + index.map_or(0, Buffer::bytes);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recipes_differ_in_what_they_say_and_in_nothing_else() {
        let [fixed, rates, for_auto_count, mcmc, mcmc_rates, all_sh] =
            Recipe::ALL.map(|r| config(r, 2_000, 40));
        assert_eq!(all_sh, for_auto_count);
        assert_eq!(fixed, TrainConfig::for_iterations(2_000));
        assert_eq!([rates.rates, mcmc_rates.rates], [for_auto_count.rates; 2]);
        let at_usual = |config: TrainConfig| TrainConfig {
            rates: fixed.rates,
            ..config
        };
        assert_eq!(at_usual(rates), fixed);
        assert_eq!(at_usual(mcmc_rates), mcmc);
        assert_eq!(mcmc.strategy, StrategyKind::Mcmc);
    }

    #[test]
    fn nothing_is_run_twice_under_two_names() {
        for iterations in [100, 2_000, 30_000] {
            let constants = recipes(iterations).into_iter();
            // Which differs in no constant.
            let found = constants
                .filter(|recipe| *recipe != Recipe::ParsimonyAllSh)
                .map(|r| config(r, iterations, 40));
            let found: Vec<TrainConfig> = found.collect();
            for (i, one) in found.iter().enumerate() {
                assert!(found[..i].iter().all(|other| other != one), "{one:?}");
            }
        }
        assert!(recipes(2_000).contains(&Recipe::Mcmc));
    }
}
