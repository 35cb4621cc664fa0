//! Training runs of every setting and several seeds: quality of held-out views over time.

use super::ChartPlan;
use super::settings::{self, RunSetting};
use crate::Result;
use crate::gpu::Gpu;
use crate::lab::chart::RunPoint;
use crate::lab::evaluator::held_out;
use crate::metrics::MeanScore;
use crate::render::Evaluator;
use crate::scene::{Dataset, Splats};
use crate::stats::Interval;
use crate::train::{TrainConfig, Trainer};
use std::time::Instant;

pub(super) use crate::lab::evaluator::BACKGROUND;

/// Seconds of training before the first intermediate evaluation; later ones are at doubled times, through 5, 10, 20 and
/// 40.
const FIRST_EVALUATION: f64 = 0.625;

/// Floats of a splat besides its harmonics: mean, quaternion, log-scale, opacity.
const GEOMETRY_FLOATS: usize = 11;

/// Points of all settings, and the scene of the first default run.
pub(super) fn measure(
    gpu: &Gpu,
    dataset: &Dataset,
    plan: &ChartPlan,
    progress: &mut dyn FnMut(&str),
) -> Result<(Vec<RunPoint>, Splats)> {
    let mut evaluator = held_out(gpu, dataset)?;
    // All seeds of a setting, in order.
    let mut seeds = |(knob, config): &RunSetting| -> Result<Vec<TrainingRun>> {
        let (name, of) = (knob.name(), plan.seeds);
        let seed = |seed| {
            progress(&format!("training: {name}, run {} of {of}", seed + 1));
            let mut config = config.clone();
            config.seed = seed;
            run(gpu, dataset, &mut evaluator, config)
        };
        (0..plan.seeds.max(1)).map(seed).collect()
    };
    let default = settings::default_run(plan, dataset);
    let runs = seeds(&default)?;
    let usual: Vec<f64> = runs.iter().map(TrainingRun::psnr_db).collect();
    let mut points = vec![point(&default, &runs, &usual)];
    let splats = runs.into_iter().next().map(|run| run.splats).unwrap_or_default();
    for setting in settings::of_runs(plan, dataset, splats.len() as u32) {
        points.push(point(&setting, &seeds(&setting)?, &usual));
    }
    Ok((points, splats))
}

/// The scene of one run.
pub(super) fn splats(gpu: &Gpu, dataset: &Dataset, config: TrainConfig) -> Result<Splats> {
    let mut trainer = Trainer::new(gpu, dataset, config)?;
    while !trainer.is_done() {
        trainer.step()?;
    }
    trainer.splats()
}

/// Scene, time and quality of one run.
struct TrainingRun {
    splats: Splats,
    seconds: f64,
    score: MeanScore,
    /// Seconds and PSNR of the intermediate evaluations.
    course: Vec<(f64, f64)>,
}

impl TrainingRun {
    fn psnr_db(&self) -> f64 {
        self.score.psnr_db.unwrap_or(f64::NAN)
    }
}

/// Means over the runs of a setting; `usual` are the decibels of the default ones, by seed.
fn point((knob, _): &RunSetting, runs: &[TrainingRun], usual: &[f64]) -> RunPoint {
    let mean = |figure: &dyn Fn(&TrainingRun) -> f64| Interval::of_mean(&runs.iter().map(figure).collect::<Vec<f64>>());
    let pairs = runs.iter().zip(usual);
    let gains: Vec<f64> = pairs.map(|(run, usual)| run.psnr_db() - usual).collect();
    let bytes = |splats: &Splats| 4 * splats.len() * (GEOMETRY_FLOATS + splats.sh_stride());
    RunPoint {
        knob: knob.clone(),
        psnr_db: mean(&TrainingRun::psnr_db),
        gain_db: Interval::of_mean(&gains),
        ssim: mean(&|r| r.score.ssim.unwrap_or(f64::NAN)),
        seconds: mean(&|r| r.seconds),
        splats: mean(&|r| r.splats.len() as f64),
        megabytes: mean(&|r| bytes(&r.splats) as f64 * 1e-6),
        course: course(runs),
    }
}

/// Evaluations at times that all runs have, then their mean end.
fn course(runs: &[TrainingRun]) -> Vec<(f64, Interval)> {
    let mut course = Vec::new();
    for (time, _) in &runs[0].course {
        let same = |run: &TrainingRun| run.course.iter().find(|(at, _)| at == time).copied();
        let values: Vec<f64> = runs.iter().filter_map(same).map(|(_, psnr)| psnr).collect();
        if values.len() == runs.len() {
            course.push((*time, Interval::of_mean(&values)));
        }
    }
    let ends: Vec<f64> = runs.iter().filter_map(|r| r.score.psnr_db).collect();
    let seconds: Vec<f64> = runs.iter().map(|r| r.seconds).collect();
    course.push((Interval::of_mean(&seconds).value, Interval::of_mean(&ends)));
    course
}

fn run(gpu: &Gpu, dataset: &Dataset, evaluator: &mut Evaluator<'_>, config: TrainConfig) -> Result<TrainingRun> {
    let mut trainer = Trainer::new(gpu, dataset, config)?;
    let (mut seconds, mut next) = (0.0, FIRST_EVALUATION);
    let mut course = Vec::new();
    while !trainer.is_done() {
        let start = Instant::now();
        trainer.step()?;
        if seconds + start.elapsed().as_secs_f64() >= next {
            // The steps in flight count as training time, the evaluation does not.
            trainer.finish()?;
            seconds += start.elapsed().as_secs_f64();
            let score = MeanScore::of(&evaluator.scores(&trainer.splats()?)?);
            course.push((next, score.psnr_db.unwrap_or(f64::NAN)));
            while next <= seconds {
                next *= 2.0;
            }
        } else {
            seconds += start.elapsed().as_secs_f64();
        }
    }
    let start = Instant::now();
    trainer.finish()?;
    seconds += start.elapsed().as_secs_f64();
    let splats = trainer.splats()?;
    Ok(TrainingRun {
        score: MeanScore::of(&evaluator.scores(&splats)?),
        splats,
        seconds,
        course,
    })
}
