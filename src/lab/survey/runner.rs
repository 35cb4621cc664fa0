//! One training run of a survey, from its recipe to its results; built-in scenes, and checksums of data sets.
//!
//! All recipes take the same steps on the same photographs; [`config`] has their differences. Time includes the work
//! between steps, but not loading and evaluation.
//!
//! **Invariant:** except for times and the date, the same task gives the same run on the same device.

use super::{Recipe, SurveyRun};
use crate::gpu::{Buffer, Gpu};
use crate::io;
use crate::lab::bench::{CpuClock, record};
use crate::lab::evaluator::{evaluator, frame_ms, held_out};
use crate::lab::synth::{self, Kind, SynthOptions};
use crate::metrics::MeanScore;
use crate::render::{Model, ViewEvaluation};
use crate::scene::{Dataset, Splats, Split};
use crate::simplify::{AutoRun, CountController, History, for_auto_count, reduce_harmonics};
use crate::train::checkpoint::fingerprint;
use crate::train::config::LearningRates;
use crate::train::{StrategyKind, TrainConfig, Trainer};
use crate::{Error, Result};
use std::path::Path;
use std::time::Instant;

/// Steps of [`Task::warm_up`].
const WARM_UP: u32 = 3;

/// A built-in scene in photographs of this width and three quarters of it in height; every eighth is held out.
pub fn built_in(kind: Kind, width: u32) -> Dataset {
    synth::scene(kind).dataset(&SynthOptions {
        views: kind.views(),
        width,
        height: (width * 3 / 4).max(1),
        ..SynthOptions::default()
    })
}

/// Checksum of a data set's training views and points, hexadecimal. The colours of points are included, photographs are
/// not.
pub fn checksum(dataset: &Dataset) -> String {
    let mut hash = crc32fast::Hasher::new();
    hash.update(&fingerprint(dataset).to_le_bytes());
    for point in &dataset.points {
        let position = point.position.iter().flat_map(|x| x.to_le_bytes());
        let color = point.color.iter().flat_map(|x| x.to_le_bytes());
        hash.update(&position.chain(color).collect::<Vec<u8>>());
    }
    format!("{:08x}", hash.finalize())
}

/// A run to be done.
#[derive(Clone, Debug)]
pub struct Task<'a> {
    /// Photographs of the scene, some of them held out.
    pub dataset: &'a Dataset,
    /// Scene, recipe, seed, steps, allowed loss and, for MCMC, limit of the splat count.
    pub settings: SurveyRun,
}

/// Constants of a run where so many training views see a point, without the limit of MCMC.
pub fn config(recipe: Recipe, usual: TrainConfig, views_per_point: f64) -> TrainConfig {
    let at_rates_of = |rates: LearningRates, config: TrainConfig| TrainConfig { rates, ..config };
    let for_auto_count = for_auto_count(usual.clone(), views_per_point);
    match recipe {
        Recipe::Fixed => usual,
        Recipe::FixedRates => at_rates_of(for_auto_count.rates, usual),
        Recipe::Parsimony | Recipe::ParsimonyAllSh => for_auto_count,
        Recipe::Mcmc => usual.with_strategy(StrategyKind::Mcmc),
        Recipe::McmcRates => at_rates_of(for_auto_count.rates, usual.with_strategy(StrategyKind::Mcmc)),
    }
}

impl Task<'_> {
    /// Constants of the run.
    ///
    /// # Errors
    /// A setting that is not valid.
    fn config(&self) -> Result<TrainConfig> {
        let settings = &self.settings;
        let setting = match settings.setting.is_empty() {
            true => &[],
            false => std::slice::from_ref(&settings.setting),
        };
        let with_setting = |config: TrainConfig| config.with_settings(setting).map_err(Error::Config);
        // Before, for constants that others are derived from; and after, for the derived ones.
        let usual = TrainConfig::for_iterations(settings.iterations).for_dataset(self.dataset);
        let usual = with_setting(usual)?;
        let config = config(settings.recipe, usual, self.dataset.views_per_point());
        let mut config = with_setting(config)?;
        config.seed = settings.seed;
        config.max_splats = settings.max_splats;
        config.auto.loss_db = settings.loss_db;
        Ok(config)
    }

    /// The run without its results.
    pub fn planned(&self, gpu: &Gpu) -> SurveyRun {
        let count = |split| self.dataset.split(split).len();
        let first = self.dataset.views.first().map(|view| view.camera);
        SurveyRun {
            train_views: count(Split::Train),
            test_views: count(Split::Test),
            width: first.map_or(0, |camera| camera.width),
            height: first.map_or(0, |camera| camera.height),
            data: checksum(self.dataset),
            device: record::slug(&gpu.caps().name),
            version: env!("CARGO_PKG_VERSION").into(),
            ..self.settings.clone()
        }
    }

    /// Takes a few steps that are not timed: a device may compile kernels at their first use.
    pub fn warm_up(&self, gpu: &Gpu) -> Result<()> {
        let mut trainer = Trainer::new(gpu, self.dataset, self.config()?)?;
        while trainer.iteration() < WARM_UP && !trainer.is_done() {
            trainer.step()?;
        }
        trainer.finish().map(|_| ())
    }

    /// Trains and evaluates. `progress` is called before every step; if it returns `false` the result is `None`; `show`
    /// is called with every test view. The scene is written to `folder` to measure its size, and removed.
    ///
    /// # Errors
    /// Those of the device, of photographs that cannot be read, and of a folder that cannot be written to.
    pub fn run(
        &self,
        gpu: &Gpu,
        folder: &Path,
        progress: &mut dyn FnMut(u32) -> bool,
        show: &dyn Fn(ViewEvaluation<'_>) -> Result<()>,
    ) -> Result<Option<SurveyRun>> {
        let mut test = held_out(gpu, self.dataset)?;
        let Some((splats, trained)) = self.train(gpu, progress)? else {
            return Ok(None);
        };
        let scores = test.map(&splats, |evaluated| {
            show(evaluated)?;
            Ok(evaluated.score())
        })?;
        let score = MeanScore::of(&scores);
        let mut training = evaluator(gpu, self.dataset, Split::Train);
        let train = MeanScore::of(&training.scores(&splats)?);
        let model = Model::upload(gpu, &splats)?;
        let (frame_ms, frame_cpu_ms) = frame_ms(gpu, self.dataset, &splats, &model)?;
        let reduced = reduce_harmonics(&splats, 0.0);
        Ok(Some(SurveyRun {
            date: record::today(),
            splats: splats.len(),
            splats_by_degree: reduced.count_from_degree.to_vec(),
            psnr_db: score.psnr_db,
            ssim: score.ssim,
            train_psnr_db: train.psnr_db,
            train_ssim: train.ssim,
            ply_bytes: file_bytes(folder, &splats)?,
            device_bytes_by_degree: device_bytes(&model),
            sh_floats: reduced.floats,
            frame_ms,
            frame_cpu_ms,
            ..trained
        }))
    }

    /// The scene, and the run with times and history of the training.
    fn train(&self, gpu: &Gpu, progress: &mut dyn FnMut(u32) -> bool) -> Result<Option<(Splats, SurveyRun)>> {
        let mut run = AutoRun::new(gpu, self.dataset, self.config()?)?;
        let (start, clock) = (Instant::now(), CpuClock::now());
        if matches!(self.settings.recipe, Recipe::Parsimony | Recipe::ParsimonyAllSh) {
            run = run.controlled(|trainer, dataset| {
                let mut controller = CountController::begin(trainer, dataset, false)?;
                if self.settings.recipe == Recipe::ParsimonyAllSh {
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
        let (train_seconds, cpu_ns) = (start.elapsed().as_secs_f64(), clock.elapsed_ns());
        let history = run.controller().map(CountController::history);
        let points = history.map(History::points).unwrap_or_default();
        let trained = SurveyRun {
            train_seconds,
            cpu_seconds: cpu_ns.map(|ns| 1e-9 * ns),
            settled_from: history.and_then(|history| history.settled_from),
            point_splats: points.iter().map(|point| point.splats as f64).collect(),
            point_lost_db: points.iter().map(|point| point.loss.held_out.psnr_db.mean).collect(),
            point_lost_ssim: points.iter().map(|point| point.loss.held_out.ssim.mean).collect(),
            ..self.planned(gpu)
        };
        Ok(Some((run.splats()?, trained)))
    }
}

/// Bytes of the scene's file.
fn file_bytes(folder: &Path, splats: &Splats) -> Result<u64> {
    let path = folder.join("needs.ply");
    io::ply::write(&path, splats)?;
    let bytes = std::fs::metadata(&path).map_err(Error::io(&path))?.len();
    std::fs::remove_file(&path).map_err(Error::io(&path))?;
    Ok(bytes)
}

/// Bytes on the device by the stored degree.
fn device_bytes(model: &Model) -> Vec<u64> {
    let mut bytes = vec![0; 4];
    for block in model.blocks.of(model.counts) {
        let index = model.splat_from_slot.get(block.index);
        bytes[block.degree as usize] += model.params[block.index].bytes() + index.map_or(0, Buffer::bytes);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_sizes_and_scenes_have_other_checksums() {
        let found = [
            built_in(Kind::Plane, 16),
            built_in(Kind::Plane, 20),
            built_in(Kind::Sphere, 16),
        ];
        let [plane, larger, sphere] = found.each_ref().map(checksum);
        assert_eq!(plane, checksum(&built_in(Kind::Plane, 16)));
        assert!(plane != larger && plane != sphere && larger != sphere);
        assert_eq!(plane.len(), 8);
        assert_eq!(found[0].split(Split::Test).len(), Kind::Plane.views() / 8);
    }

    #[test]
    fn recipes_differ_in_their_own_constants_alone() {
        let [fixed, rates, for_auto_count, mcmc, mcmc_rates, all_sh] =
            Recipe::ALL.map(|r| config(r, TrainConfig::for_iterations(2_000), 10.0));
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
}
