//! Survey of splat counts: every scene trained by every recipe from several seeds, on the same photographs for the same
//! number of steps.
//!
//! [`runner`] trains and measures a run, [`record`] reads and writes runs as CSV, and [`page`] shows them.

pub mod page;
pub mod record;
pub mod runner;
mod sensitivity;
mod variations;

pub use variations::variations;

use crate::lab::page::distinct;
use crate::stats::Interval;
use serde::{Deserialize, Serialize};

/// Method of training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Recipe {
    /// Adaptive density control with its usual constants.
    #[default]
    Fixed,
    /// The same at the learning rates of `Parsimony`.
    FixedRates,
    /// Splat count chosen by the loss of held-out views.
    Parsimony,
    /// MCMC limited to the final splat count of `Parsimony`.
    Mcmc,
    /// The same at the learning rates of `Parsimony`.
    McmcRates,
    /// Parsimony without the reduction of harmonics.
    ParsimonyAllSh,
}

impl Recipe {
    /// All recipes in the order of their runs; those of MCMC follow the run that sets their count.
    pub const ALL: [Recipe; 6] = [
        Recipe::Fixed,
        Recipe::FixedRates,
        Recipe::Parsimony,
        Recipe::Mcmc,
        Recipe::McmcRates,
        Recipe::ParsimonyAllSh,
    ];

    /// Recipes of a survey, unless chosen: those at the rates of `Parsimony` differ from the others only where few
    /// views see a point.
    pub const USUAL: [Recipe; 4] = [Recipe::Fixed, Recipe::Parsimony, Recipe::Mcmc, Recipe::ParsimonyAllSh];

    /// Name in files and on command lines, and that on the page.
    const fn names(self) -> [&'static str; 2] {
        match self {
            Recipe::Fixed => ["fixed", "fixed recipe"],
            Recipe::FixedRates => ["fixed-rates", "fixed recipe, same rates"],
            Recipe::Parsimony => ["parsimony", "parsimony"],
            Recipe::Mcmc => ["mcmc", "MCMC, same count"],
            Recipe::McmcRates => ["mcmc-rates", "MCMC, same count and rates"],
            Recipe::ParsimonyAllSh => ["parsimony-all-sh", "parsimony, all harmonics"],
        }
    }

    /// Name in files and on command lines.
    pub fn name(self) -> &'static str {
        self.names()[0]
    }

    /// Name on the page.
    pub fn title(self) -> &'static str {
        self.names()[1]
    }
}

/// Settings and results of one run. Lists by degree hold degrees 0 to 3.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SurveyRun {
    /// Name of the scene.
    pub scene: String,
    /// Method of training.
    pub recipe: Recipe,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Constant of parsimony at another value, as NAME=VALUE; empty: all at their usual values.
    #[serde(default)]
    pub setting: String,
    /// Steps.
    pub iterations: u32,
    /// PSNR that held-out views may lose by fewer splats, decibels.
    #[serde(alias = "gain_db")]
    pub loss_db: f64,
    /// Limit of the splat count.
    pub max_splats: Option<u32>,
    /// Number of training views.
    pub train_views: usize,
    /// Number of test views.
    pub test_views: usize,
    /// Pixels of the first view.
    pub width: u32,
    /// Pixels of the first view.
    pub height: u32,
    /// Checksum of views and points, hexadecimal.
    pub data: String,
    /// Device, as a folder's name.
    pub device: String,
    /// Date of its end, year-month-day.
    pub date: String,
    /// Version of the program.
    pub version: String,
    /// Splats of the result.
    pub splats: usize,
    /// The same by degree.
    #[serde(with = "record::list")]
    pub splats_by_degree: Vec<usize>,
    /// Mean PSNR of the test views, decibels; `None` without any error.
    pub psnr_db: Option<f64>,
    /// Mean SSIM of the test views.
    pub ssim: Option<f64>,
    /// Mean PSNR of the training views, decibels; `None` also in records from before it was measured.
    #[serde(default)]
    pub train_psnr_db: Option<f64>,
    /// Mean SSIM of the training views; `None` also in records from before it was measured.
    #[serde(default)]
    pub train_ssim: Option<f64>,
    /// Wall time of training, without loading and evaluation.
    pub train_seconds: f64,
    /// Processor time of the same, of all threads.
    pub cpu_seconds: Option<f64>,
    /// Bytes of the scene's file.
    pub ply_bytes: u64,
    /// Bytes of the scene on the device by the stored degree.
    #[serde(with = "record::list")]
    pub device_bytes_by_degree: Vec<u64>,
    /// Floats of harmonics, each splat at its own degree; 48 a splat at degree 3.
    pub sh_floats: usize,
    /// Median time of a frame of a test view on the device, milliseconds.
    pub frame_ms: f64,
    /// Median processor time of such a frame, milliseconds.
    pub frame_cpu_ms: Option<f64>,
    /// Iteration from which the count was fixed.
    pub settled_from: Option<u32>,
    /// Splats at the end of growth and in each round.
    #[serde(with = "record::list")]
    pub point_splats: Vec<f64>,
    /// PSNR that the held-out views lost there, decibels.
    #[serde(default, with = "record::list")]
    pub point_lost_db: Vec<f64>,
    /// SSIM that they lost there.
    #[serde(default, with = "record::list")]
    pub point_lost_ssim: Vec<f64>,
}

/// Floats of the harmonics of a splat of degree 3.
const SH_FLOATS: f64 = 48.0;

impl SurveyRun {
    /// Scene, recipe, seed and setting, which identify a run of a survey.
    pub fn key(&self) -> (&str, Recipe, u64, &str) {
        (&self.scene, self.recipe, self.seed, &self.setting)
    }

    /// The first setting that differs, with both values, if the two runs do not belong to one survey.
    pub fn conflict(&self, other: &SurveyRun) -> Option<String> {
        let settings = |run: &SurveyRun| {
            [
                ("iterations", run.iterations.to_string()),
                ("the loss allowed", run.loss_db.to_string()),
                ("the device", run.device.clone()),
                ("the size", format!("{} × {}", run.width, run.height)),
                ("the data set's checksum", run.data.clone()),
            ]
        };
        // Size and checksum are compared only for the same scene.
        let shared = if self.scene == other.scene { 5 } else { 3 };
        let mut pairs = settings(self).into_iter().zip(settings(other)).take(shared);
        let ((name, a), (_, b)) = pairs.find(|(a, b)| a != b)?;
        Some(format!("{name} was {a} and is {b} now"))
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        self.device_bytes_by_degree.iter().sum()
    }

    /// Counts of the rounds, and losses of the held-out views in PSNR and SSIM.
    fn points(&self) -> Vec<(f64, [f64; 2])> {
        let losses = self.point_lost_db.iter().zip(&self.point_lost_ssim);
        let points = self.point_splats.iter().zip(losses);
        points
            .map(|(&splats, (&psnr_db, &ssim))| (splats, [psnr_db, ssim]))
            .collect()
    }

    /// Share of the floats of all harmonics at degree 3.
    pub fn sh_share(&self) -> f64 {
        self.sh_floats as f64 / (SH_FLOATS * self.splats.max(1) as f64)
    }
}

/// Names of the scenes, in the order of their first runs.
pub fn scenes(runs: &[SurveyRun]) -> Vec<&str> {
    distinct(runs.iter().map(|run| run.scene.as_str()))
}

/// Mean of a value over the runs that have it.
fn mean(runs: &[&SurveyRun], value: fn(&SurveyRun) -> Option<f64>) -> Option<Interval> {
    interval_of(runs.iter().filter_map(|run| value(run)).collect())
}

/// Mean difference of a value to the other runs of the same seeds.
fn paired_difference(
    runs: &[&SurveyRun],
    others: &[&SurveyRun],
    value: fn(&SurveyRun) -> Option<f64>,
) -> Option<Interval> {
    let difference = |run: &&SurveyRun| {
        let other = others.iter().find(|other| other.seed == run.seed)?;
        Some(value(run)? - value(other)?)
    };
    interval_of(runs.iter().filter_map(difference).collect())
}

fn interval_of(mut values: Vec<f64>) -> Option<Interval> {
    values.retain(|value| value.is_finite());
    (!values.is_empty()).then(|| Interval::of_mean(&values))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A run of a scene with these splats and decibels.
    pub(crate) fn run(scene: &str, recipe: Recipe, seed: u64, splats: usize, psnr: f64) -> SurveyRun {
        SurveyRun {
            scene: scene.into(),
            recipe,
            seed,
            iterations: 100,
            splats,
            splats_by_degree: vec![splats, 0, 0, 0],
            device_bytes_by_degree: vec![56 * splats as u64, 0, 0, 0],
            sh_floats: 3 * splats,
            psnr_db: Some(psnr),
            ssim: Some(0.01 * psnr),
            train_psnr_db: Some(psnr + 2.0),
            train_seconds: 2.0,
            cpu_seconds: Some(splats as f64),
            ply_bytes: 248 * splats as u64,
            frame_ms: 1.0,
            ..SurveyRun::default()
        }
    }

    /// Two scenes by three recipes from two seeds.
    pub(crate) fn survey() -> Vec<SurveyRun> {
        let mut runs = Vec::new();
        for (scene, unit) in [("a<b", 100), ("rich", 2500)] {
            for seed in 0..2 {
                let by = |recipe, splats, psnr| run(scene, recipe, seed, splats, psnr);
                let (drift, more) = (seed as f64, 10 * seed as usize);
                runs.push(by(Recipe::Fixed, 4 * unit, 30.0 + drift));
                runs.push(by(Recipe::Parsimony, unit + more, 30.1 + drift));
                runs.push(by(Recipe::Mcmc, unit, 29.7 + 2.0 * drift));
            }
        }
        runs
    }

    #[test]
    fn runs_are_compared_seed_by_seed() {
        let survey = survey();
        assert_eq!(scenes(&survey), ["a<b", "rich"]);
        let of = |recipe| -> Vec<&SurveyRun> {
            let runs = survey.iter().filter(|run| run.scene == "a<b");
            runs.filter(|run| run.recipe == recipe).collect()
        };
        let difference = |a, b| paired_difference(&of(a), &of(b), |run| run.psnr_db);
        // The seeds drift together, so that the difference is constant.
        let found = difference(Recipe::Parsimony, Recipe::Fixed);
        assert!(found.is_some_and(|i| (i.value - 0.1).abs() < 1e-9 && i.high - i.low < 1e-6));
        let found = difference(Recipe::Parsimony, Recipe::Mcmc);
        assert!(found.is_some_and(|i| (i.value + 0.1).abs() < 1e-9 && i.high - i.low > 1.0));
        assert_eq!(difference(Recipe::Parsimony, Recipe::FixedRates), None);
        let splats = mean(&of(Recipe::Parsimony), |run| Some(run.splats as f64));
        assert_eq!(splats.map(|i| i.value), Some(105.0));
    }

    #[test]
    fn runs_of_other_settings_conflict() {
        let one = run("a", Recipe::Fixed, 0, 1, 30.0);
        assert_eq!(one.conflict(&run("b", Recipe::Mcmc, 3, 5, 31.0)), None);
        let longer = SurveyRun {
            iterations: 200,
            ..one.clone()
        };
        let told = one.conflict(&longer);
        assert_eq!(told.as_deref(), Some("iterations was 100 and is 200 now"));
        let other = |scene: &str| SurveyRun {
            data: "1f".into(),
            ..run(scene, Recipe::Fixed, 0, 1, 30.0)
        };
        assert!(one.conflict(&other("a")).is_some());
        assert_eq!(one.conflict(&other("b")), None);
    }
}
