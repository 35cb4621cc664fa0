//! Knobs of the chart and their settings.

use super::ChartPlan;
use crate::lab::chart::Knob;
use crate::reference::bound::{Approximations, color_errors};
use crate::render::{Accuracy, Precision};
use crate::scene::{Dataset, ScreenFilter, Splats, sh_coefficient_count};
use crate::simplify::reduce_harmonics;
use crate::train::{StrategyKind, TrainConfig};

/// Options of a drawn frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FrameSetting {
    pub(super) knob: Knob,
    pub(super) accuracy: Accuracy,
    /// Highest degree of harmonics drawn.
    pub(super) sh_degree: u32,
    /// Storage precision of the scene on the device.
    pub(super) precision: Precision,
    /// The error of [`prune`](crate::simplify::prune()), of 1; `None`: all splats are drawn.
    pub(super) pruned: Option<f64>,
    /// The error of [`reduce_harmonics`], of 1; `None`: all SH degrees are kept.
    pub(super) reduced: Option<f64>,
}

impl FrameSetting {
    /// Approximations of the setting for the reference; `removed` flags the pruned splats.
    pub(super) fn approximations(&self, splats: &Splats, removed: &[bool]) -> Approximations {
        let kept = 3 * sh_coefficient_count(self.sh_degree);
        let is_whole = self.precision == Precision::Full;
        let stored = (!is_whole).then(|| self.precision.rounded(splats));
        let reduced = self.reduced.map(|e| reduce_harmonics(splats, e).splats);
        let stride = splats.sh_stride();
        let drawn = |i: usize| match (&stored, &reduced) {
            _ if i % stride >= kept => 0.0,
            (_, Some(reduced)) => match (i % stride, reduced.sh_stride()) {
                (place, stride_left) if place < stride_left => reduced.sh[i / stride * stride_left + place],
                _ => 0.0,
            },
            (Some(stored), None) => stored.sh[i],
            (None, None) => splats.sh[i],
        };
        let accuracy = &self.accuracy;
        Approximations {
            alpha_min: f64::from(accuracy.alpha_min),
            transmittance_min: f64::from(accuracy.transmittance_min),
            color_error: match is_whole && reduced.is_none() && self.sh_degree >= splats.sh_degree {
                true => Vec::new(),
                false => color_errors(splats, |i| f64::from(drawn(i))),
            },
            removed: removed.to_vec(),
            stored,
        }
    }
}

/// Name of a series.
const HARMONICS: &str = "harmonics";

/// A frame with the default thresholds.
fn frame(series: &str, setting: impl Into<String>) -> FrameSetting {
    FrameSetting {
        knob: Knob::new(series, setting),
        accuracy: Accuracy::default(),
        sh_degree: 3,
        precision: Precision::Full,
        pruned: None,
        reduced: None,
    }
}

/// A frame with these thresholds.
fn cut_frame(series: &str, setting: String, transmittance_min: f32, alpha_min: f32) -> FrameSetting {
    let mut frame = frame(series, setting);
    frame.accuracy.transmittance_min = transmittance_min;
    frame.accuracy.alpha_min = alpha_min;
    frame
}

/// Stop alone, with the smallest cut.
fn stop(transmittance_min: f32) -> FrameSetting {
    let setting = format!("{transmittance_min:.0e}");
    cut_frame("stop alone", setting, transmittance_min, ALPHA_LEAST)
}

/// Cut alone, with the smallest stop.
fn cut(number: u32) -> FrameSetting {
    let setting = format!("1/{number}");
    cut_frame("cut alone", setting, TRANSMITTANCE_LEAST, 1.0 / number as f32)
}

fn together(transmittance_min: f32, number: u32) -> FrameSetting {
    let setting = format!("{transmittance_min:.0e}, 1/{number}");
    cut_frame("stop and cut", setting, transmittance_min, 1.0 / number as f32)
}

fn harmonics(sh_degree: u32) -> FrameSetting {
    FrameSetting {
        sh_degree,
        ..frame(HARMONICS, format!("degree {sh_degree}"))
    }
}

fn stored(precision: Precision, setting: &str) -> FrameSetting {
    FrameSetting {
        precision,
        ..frame("stored as halves", setting)
    }
}

fn pruned(number: u32) -> FrameSetting {
    FrameSetting {
        pruned: Some(1.0 / f64::from(number)),
        ..frame("pruned", format!("1/{number}"))
    }
}

fn reduced(number: u32) -> FrameSetting {
    FrameSetting {
        reduced: Some(1.0 / f64::from(number)),
        ..frame("harmonics by splat", format!("1/{number}"))
    }
}

/// Smallest cut and stop.
const ALPHA_LEAST: f32 = 1e-6;
const TRANSMITTANCE_LEAST: f32 = 1e-9;

/// Pairs of stop and cut of about equal cost, from exact to coarse, and some unequal ones.
const TOGETHER: [(f32, u32); 9] = [
    (1e-3, 1024),
    (1e-3, 255),
    (1e-2, 1024),
    (4e-3, 512),
    (1e-2, 512),
    (1e-3, 128),
    (4e-3, 64),
    (1e-2, 64),
    (3e-2, 32),
];

/// The default, and every knob on its own from exact to coarse; then stop and cut together.
pub(super) fn of_frames(sh_degree: u32, plan: &ChartPlan) -> Vec<FrameSetting> {
    let mut default = frame("default", "1e-4, 1/255");
    default.knob.is_default = true;
    let mut settings = vec![
        default,
        stored(Precision::HalfHarmonics, "harmonics"),
        stored(Precision::Half, "all but means"),
    ];
    if plan.is_quick {
        settings.extend([stop(1e-2), cut(32), pruned(64), reduced(64)]);
        settings.extend((0..sh_degree.min(1)).map(harmonics));
    } else {
        settings.extend([1e-5, 1e-4, 1e-3, 4e-3, 1e-2, 3e-2].map(stop));
        settings.extend([1024, 512, 255, 128, 64, 32].map(cut));
        settings.extend([512, 128, 32].map(pruned));
        settings.extend([512, 256, 128, 64, 32].map(reduced));
        settings.extend((0..sh_degree).rev().map(harmonics));
        settings.extend(TOGETHER.map(|(t, number)| together(t, number)));
    }
    for setting in &mut settings {
        setting.sh_degree = setting.sh_degree.min(sh_degree);
    }
    settings
}

/// Settings of a training step: thresholds. Harmonics above the drawn degree and pruned splats have no gradients to
/// compare, and half precision is not trained.
pub(super) fn of_gradients(sh_degree: u32, plan: &ChartPlan) -> Vec<FrameSetting> {
    let is_whole = |s: &FrameSetting| s.precision == Precision::Full && s.sh_degree == sh_degree;
    let is_cut = |s: &FrameSetting| is_whole(s) && s.pruned.is_none() && s.reduced.is_none();
    of_frames(sh_degree, plan).into_iter().filter(is_cut).collect()
}

/// Knob and configuration of a training run.
pub(super) type RunSetting = (Knob, TrainConfig);

/// The default run of a data set.
pub(super) fn default_run(plan: &ChartPlan, dataset: &Dataset) -> RunSetting {
    let mut knob = Knob::new("default", format!("{} steps", plan.iterations));
    knob.is_default = true;
    let config = TrainConfig::for_iterations(plan.iterations);
    (knob, config.for_dataset(dataset))
}

/// The other runs; `splats` is the final count of the default one.
pub(super) fn of_runs(plan: &ChartPlan, dataset: &Dataset, splats: u32) -> Vec<RunSetting> {
    let base = TrainConfig::for_iterations(plan.iterations).for_dataset(dataset);
    let with = |series: &str, setting: String, change: &dyn Fn(&mut TrainConfig)| {
        let mut config = base.clone();
        change(&mut config);
        (Knob::new(series, setting), config)
    };
    if plan.is_quick {
        return vec![with(HARMONICS, "degree 0".into(), &|c| c.sh_degree = 0)];
    }
    let mut runs = Vec::new();
    for steps in [plan.iterations / 2, plan.iterations * 2] {
        runs.push(with("steps", steps.to_string(), &|c| {
            *c = TrainConfig::for_iterations(steps).for_dataset(dataset);
        }));
    }
    for share in [2, 4] {
        let most = (splats / share).max(1);
        runs.push(with("splats at most", most.to_string(), &|c| c.max_splats = Some(most)));
    }
    for sh_degree in [1, 0] {
        let setting = format!("degree {sh_degree}");
        runs.push(with(HARMONICS, setting, &|c| c.sh_degree = sh_degree));
    }
    for frame in [together(1e-2, 255), together(1e-4, 128), together(1e-2, 64)] {
        let Knob { series, setting, .. } = frame.knob;
        runs.push(with(&series, setting, &|c| c.accuracy = frame.accuracy));
    }
    for percent in [25, 50] {
        let until = plan.iterations * percent / 100;
        let setting = format!("first {percent} % at half");
        runs.push(with("photographs", setting, &|c| c.coarse_until = until));
    }
    runs.push(with("loss", "SSIM of every pixel".into(), &|c| c.ssim_stride = 1));
    runs.push(with("loss", "L1 alone".into(), &|c| c.lambda_dssim = 0.0));
    runs.push(with(HARMONICS, "updated in every step".into(), &|c| {
        c.adam.color_every = 1
    }));
    runs.push(with("render mode", "mip".into(), &|c| c.filter = ScreenFilter::Mip));
    for most in [splats, (splats / 2).max(1)] {
        let setting = format!("MCMC, {most} splats");
        runs.push(with("strategy", setting, &|c| {
            *c = c.clone().with_strategy(StrategyKind::Mcmc);
            c.max_splats = Some(most);
        }));
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_setting_is_valid_and_named_once() {
        for plan in [ChartPlan::USUAL, ChartPlan::QUICK] {
            for sh_degree in 0..=3 {
                let frames = of_frames(sh_degree, &plan);
                let names: BTreeSet<String> = frames.iter().map(|s| s.knob.name()).collect();
                assert_eq!(names.len(), frames.len());
                assert_eq!(frames.iter().filter(|s| s.knob.is_default).count(), 1);
                for setting in &frames {
                    assert!(setting.accuracy.validate().is_ok(), "{setting:?}");
                    assert!(setting.sh_degree <= sh_degree);
                }
            }
            let runs = of_runs(&plan, &Dataset::default(), 1000);
            assert!(runs.iter().all(|(_, config)| config.validate().is_ok()));
        }
    }
}
