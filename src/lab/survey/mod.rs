//! What scenes need, surveyed: every scene trained by every recipe from several seeds, on the same photographs for as many
//! steps, and what sets them apart.
//!
//! Runs come from [`bench::needs`](crate::lab::survey::runner); here they are kept as lines of a CSV file ([`csv`]), compared
//! seed by seed ([`Survey::change`], [`Survey::ratio`]), held against what was aimed at ([`Targets`]) and drawn
//! ([`page`]).

pub mod csv;
pub mod page;
mod panel;
pub mod runner;
mod scenes;
mod tables;
mod targets;

pub use targets::{Figures, Target, Targets};

use crate::simplify::Law;
use crate::stats::Interval;
use serde::{Deserialize, Serialize};

/// How a scene is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Recipe {
    /// Adaptive density control with its usual constants.
    #[default]
    Fixed,
    /// The same at the learning rates that runs to a scene's needs have: what rates do is no merit of pruning.
    FixedRates,
    /// To no more splats than the scene needs.
    Parsimony,
    /// MCMC with as many splats at most as that ended with.
    Mcmc,
    /// The same at those learning rates.
    McmcRates,
    /// To no more splats than the scene needs, with all their harmonics: what those are worth.
    ParsimonyAllSh,
}

impl Recipe {
    /// All, in the order that they are run in: MCMC has to know a count.
    pub const ALL: [Recipe; 6] = [
        Recipe::Fixed,
        Recipe::FixedRates,
        Recipe::Parsimony,
        Recipe::Mcmc,
        Recipe::McmcRates,
        Recipe::ParsimonyAllSh,
    ];

    /// The word for it, in files and on command lines.
    pub fn name(self) -> &'static str {
        match self {
            Recipe::Fixed => "fixed",
            Recipe::FixedRates => "fixed-rates",
            Recipe::Parsimony => "parsimony",
            Recipe::Mcmc => "mcmc",
            Recipe::McmcRates => "mcmc-rates",
            Recipe::ParsimonyAllSh => "parsimony-all-sh",
        }
    }

    /// What the page calls it.
    pub fn title(self) -> &'static str {
        match self {
            Recipe::Fixed => "fixed recipe",
            Recipe::FixedRates => "fixed recipe, same rates",
            Recipe::Parsimony => "parsimony",
            Recipe::Mcmc => "MCMC, same count",
            Recipe::McmcRates => "MCMC, same count and rates",
            Recipe::ParsimonyAllSh => "parsimony, all harmonics",
        }
    }
}

/// One run, and what came of it. Lists are of degrees 0 to 3 where nothing else is said.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// The scene's name.
    pub scene: String,
    /// How it was trained.
    pub recipe: Recipe,
    /// The seed of all random numbers.
    pub seed: u64,
    /// Steps.
    pub iterations: u32,
    /// The smallest gain worth paying for, decibels for a tenth more splats.
    pub gain_db: f64,
    /// Splats allowed, where they were limited.
    pub max_splats: Option<u32>,
    /// Views trained on.
    pub train_views: usize,
    /// Views judged by.
    pub test_views: usize,
    /// Pixels of the first view.
    pub width: u32,
    /// Pixels of the first view.
    pub height: u32,
    /// A checksum of views and points, hexadecimal.
    pub data: String,
    /// The device, as a name for folders.
    pub device: String,
    /// When it ended, year-month-day.
    pub date: String,
    /// The program's version.
    pub version: String,
    /// Splats in the end.
    pub splats: usize,
    /// Of each degree.
    pub splats_by_degree: Vec<usize>,
    /// Mean PSNR of the test views, decibels; none without any error.
    pub psnr_db: Option<f64>,
    /// Their mean SSIM.
    pub ssim: Option<f64>,
    /// Wall time of the training steps and all that is done between them.
    pub train_seconds: f64,
    /// Processor time of the same, of all threads.
    pub cpu_seconds: Option<f64>,
    /// Bytes of the scene's file.
    pub ply_bytes: u64,
    /// Bytes that the scene takes on the device, by the degree that splats are stored at.
    pub device_bytes_by_degree: Vec<u64>,
    /// Floats of harmonics that are left, each splat at its own degree; 48 a splat is all.
    pub sh_floats: usize,
    /// Median time of a frame of a test view by the device's clock, milliseconds.
    pub frame_ms: f64,
    /// Median processor time of such a frame, milliseconds.
    pub frame_cpu_ms: Option<f64>,
    /// The iteration from which the count was fixed.
    pub settled_from: Option<u32>,
    /// What the held-out views lost by the harmonics that went or could have gone, before the last fit, decibels.
    pub sh_lost_db: Option<f64>,
    /// Splats where a tenth more was worth just the gain, by the law.
    pub knee: Option<f64>,
    /// The law through what rounds found: limit (decibels), factor, exponent; or nothing.
    pub law: Vec<f64>,
    /// What rounds found: splats.
    pub point_splats: Vec<f64>,
    /// And their decibels on validation views.
    pub point_db: Vec<f64>,
}

/// Floats of harmonics that a splat of degree 3 has.
const SH_FLOATS: f64 = 48.0;

impl Run {
    /// Whether both are the same run on the same data set, as far as was known before they began.
    pub fn is_again(&self, other: &Run) -> bool {
        let key = |run: &Run| (run.scene.clone(), run.recipe, run.seed);
        key(self) == key(other)
    }

    /// Why the two do not belong on one page, if so: what differs, and both values.
    pub fn conflict(&self, other: &Run) -> Option<String> {
        let shared = |run: &Run| {
            [
                ("iterations", run.iterations.to_string()),
                ("the gain", run.gain_db.to_string()),
                ("the device", run.device.clone()),
            ]
        };
        let of_scene = |run: &Run| {
            [
                ("the size", format!("{} × {}", run.width, run.height)),
                ("the data set's checksum", run.data.clone()),
            ]
        };
        let mut facts: Vec<_> = shared(self).into_iter().zip(shared(other)).collect();
        if self.scene == other.scene {
            facts.extend(of_scene(self).into_iter().zip(of_scene(other)));
        }
        let differs = facts.into_iter().find(|(a, b)| a != b);
        differs.map(|((what, a), (_, b))| format!("{what} was {a} and is {b} now"))
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        self.device_bytes_by_degree.iter().sum()
    }

    /// The share of all harmonics' floats that is left.
    pub fn sh_share(&self) -> f64 {
        self.sh_floats as f64 / (SH_FLOATS * self.splats.max(1) as f64)
    }

    /// The law through what rounds found.
    pub fn law(&self) -> Option<Law> {
        match self.law[..] {
            [limit_db, factor, exponent] => Some(Law {
                limit_db,
                factor,
                exponent,
            }),
            _ => None,
        }
    }
}

/// A figure of a run.
pub type Figure = fn(&Run) -> Option<f64>;

/// Everything on the page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    /// What was trained, on what, when and with which version: name and value.
    pub facts: Vec<(String, String)>,
    /// All runs.
    pub runs: Vec<Run>,
}

impl Survey {
    /// The scenes, in the order of their first runs.
    pub fn scenes(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for run in &self.runs {
            if !names.contains(&run.scene.as_str()) {
                names.push(&run.scene);
            }
        }
        names
    }

    /// The runs of a scene by a recipe.
    pub fn of(&self, scene: &str, recipe: Recipe) -> impl Iterator<Item = &Run> {
        let wanted = move |run: &&Run| run.scene == scene && run.recipe == recipe;
        self.runs.iter().filter(wanted)
    }

    /// The mean of a figure over a recipe's runs; `None` if there is no run that has it.
    pub fn mean(&self, scene: &str, recipe: Recipe, figure: Figure) -> Option<Interval> {
        of_some(self.of(scene, recipe).filter_map(figure).collect())
    }

    /// By how much a figure is more in one recipe's runs than in another's, seed by seed: of runs that begin alike, much
    /// of what chance does is the same.
    pub fn change(&self, scene: &str, [of, to]: [Recipe; 2], figure: Figure) -> Option<Interval> {
        of_some(self.paired(scene, [of, to], figure, |a, b| a - b))
    }

    /// How many times as much it is, likewise.
    pub fn ratio(&self, scene: &str, [of, to]: [Recipe; 2], figure: Figure) -> Option<Interval> {
        of_some(self.paired(scene, [of, to], figure, |a, b| a / b))
    }

    fn paired(
        &self,
        scene: &str,
        [of, to]: [Recipe; 2],
        figure: Figure,
        compare: fn(f64, f64) -> f64,
    ) -> Vec<f64> {
        let pair = |run: &Run| {
            let other = self.of(scene, to).find(|other| other.seed == run.seed)?;
            Some(compare(figure(run)?, figure(other)?))
        };
        self.of(scene, of).filter_map(pair).collect()
    }

    /// By which share counts lie above or below their middle at most; `None` of fewer than two runs.
    pub fn spread(&self, scene: &str, recipe: Recipe) -> Option<f64> {
        let counts: Vec<usize> = self.of(scene, recipe).map(|run| run.splats).collect();
        let (least, most) = (*counts.iter().min()? as f64, *counts.iter().max()? as f64);
        (counts.len() > 1 && most > 0.0).then(|| (most - least) / (most + least))
    }
}

fn of_some(values: Vec<f64>) -> Option<Interval> {
    let values: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    (!values.is_empty()).then(|| Interval::of_mean(&values))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A run of a scene with so many splats and decibels.
    pub(crate) fn run(scene: &str, recipe: Recipe, seed: u64, splats: usize, psnr: f64) -> Run {
        Run {
            scene: scene.into(),
            recipe,
            seed,
            iterations: 100,
            splats,
            splats_by_degree: vec![splats, 0, 0, 0],
            device_bytes_by_degree: vec![56 * splats as u64, 0, 0, 0],
            sh_floats: 3 * splats,
            psnr_db: Some(psnr),
            ssim: Some(0.9),
            train_seconds: 2.0,
            cpu_seconds: Some(splats as f64),
            ply_bytes: 248 * splats as u64,
            frame_ms: 1.0,
            ..Run::default()
        }
    }

    /// Two scenes of which the second needs twenty-five times what the first does, in two seeds.
    pub(crate) fn survey() -> Survey {
        let mut runs = Vec::new();
        for (scene, unit) in [("a<b", 100), ("rich", 2500)] {
            for seed in 0..2 {
                let by = |recipe, splats, psnr| run(scene, recipe, seed, splats, psnr);
                let drift = seed as f64;
                runs.push(by(Recipe::Fixed, 4 * unit, 30.0 + drift));
                runs.push(by(
                    Recipe::Parsimony,
                    unit + 10 * seed as usize,
                    30.1 + drift,
                ));
                runs.push(by(Recipe::Mcmc, unit, 29.7 + 2.0 * drift));
            }
        }
        Survey {
            facts: vec![("device".into(), "x<y".into())],
            runs,
        }
    }

    #[test]
    fn runs_are_compared_seed_by_seed() {
        let survey = survey();
        assert_eq!(survey.scenes(), ["a<b", "rich"]);
        let pair = [Recipe::Parsimony, Recipe::Fixed];
        let found = survey.change("a<b", pair, |run| run.psnr_db);
        // The seeds drift together, so that nothing of it is left.
        assert!(found.is_some_and(|i| (i.value - 0.1).abs() < 1e-9 && i.high - i.low < 1e-6));
        let apart = survey.change("a<b", [Recipe::Parsimony, Recipe::Mcmc], |run| run.psnr_db);
        assert!(apart.is_some_and(|i| (i.value + 0.1).abs() < 1e-9 && i.high - i.low > 1.0));
        let ratio = survey.ratio("rich", pair, |run| Some(run.splats as f64));
        assert!(ratio.is_some_and(|i| (i.value - 0.2505).abs() < 1e-9));
        assert_eq!(survey.change("none", pair, |run| run.psnr_db), None);
        let rates = [Recipe::Parsimony, Recipe::FixedRates];
        assert_eq!(survey.ratio("rich", rates, |run| run.psnr_db), None);
    }

    #[test]
    fn a_spread_is_half_the_range_over_its_middle() {
        let survey = survey();
        let found = survey.spread("a<b", Recipe::Parsimony);
        assert!(found.is_some_and(|spread| (spread - 10.0 / 210.0).abs() < 1e-12));
        assert_eq!(survey.spread("a<b", Recipe::FixedRates), None);
    }

    #[test]
    fn runs_of_other_settings_conflict() {
        let one = run("a", Recipe::Fixed, 0, 1, 30.0);
        assert_eq!(one.conflict(&run("b", Recipe::Mcmc, 3, 5, 31.0)), None);
        let longer = Run {
            iterations: 200,
            ..one.clone()
        };
        let told = one.conflict(&longer);
        assert_eq!(told.as_deref(), Some("iterations was 100 and is 200 now"));
        let other = |scene: &str| Run {
            data: "1f".into(),
            ..run(scene, Recipe::Fixed, 0, 1, 30.0)
        };
        assert!(one.conflict(&other("a")).is_some());
        assert_eq!(one.conflict(&other("b")), None);
    }
}
