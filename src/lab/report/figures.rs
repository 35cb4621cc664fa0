//! `report.json`: the figures of a training run. Field names are an interface and contain the units.

use super::needs::{Needs, RunComparison};
use crate::Result;
use crate::io::atomic::write_atomically;
use crate::metrics::{MeanScore, ViewScore};
use crate::render::total;
use crate::simplify::controller_needs;
use crate::train::Trainer;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// A training run in figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Steps done; fewer than `config.iterations` if the run was interrupted.
    pub iterations: u32,
    /// Key of the random numbers.
    pub seed: u64,
    /// `adc` or `mcmc`.
    pub strategy: String,
    /// Name of the Vulkan device.
    pub device: String,
    /// Splats in the final scene.
    pub splat_count: usize,
    /// Highest spherical-harmonic degree of the final scene.
    pub sh_degree: u32,
    /// Wall time spent in training steps, over all resumed parts; without loading and evaluation.
    pub train_seconds: f64,
    /// Mean training loss over the last entry of the history; `None` before the first step.
    pub loss: Option<f64>,
    /// Means over the held-out views.
    pub test: MeanScore,
    /// Means over the views trained on.
    pub train: MeanScore,
    /// Most device memory held by buffers at one time, evaluation included.
    pub memory_peak_bytes: u64,
    /// Memory of training by buffer.
    pub memory: MemoryFigures,
    /// Loss and quality over time.
    pub history: Vec<HistoryEntry>,
    /// Scores of each held-out view.
    pub test_views: Vec<ViewScore>,
    /// Wall time by part.
    pub timings: Timings,
    /// Warnings, one sentence each.
    pub warnings: Vec<String>,
    /// Every constant of the run.
    pub config: serde_json::Value,
    /// Splat count and SH degrees that the run chose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub needs: Option<Needs>,
    /// Share of the photographs' patches that were left out at the end; `None` unless the run ignored transients.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ignored_share: Option<f64>,
}

/// Device memory of training, since it was begun or resumed: measured, and by the formula of `ashfall info --predict`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MemoryFigures {
    /// Peak of the buffers' bytes.
    pub peak_bytes: u64,
    /// Peak of the bytes reserved from the device.
    pub reserved_peak_bytes: u64,
    /// Bytes by the formula for `splats_peak` and `isects_peak`.
    pub predicted_bytes: u64,
    /// Bytes of parameters, moments, photographs and the lists of (splat, tile) pairs with their data.
    pub essential_bytes: u64,
    /// Most splats trained at one time.
    pub splats_peak: usize,
    /// Most (splat, tile) pairs of one frame.
    pub isects_peak: usize,
    /// Bytes at the peak by the name of the buffers.
    pub buffers: BTreeMap<String, u64>,
}

impl MemoryFigures {
    /// Memory of a trainer and its device so far, under a count controller or without.
    pub fn of(trainer: &Trainer<'_>, is_controlled: bool) -> MemoryFigures {
        let (gpu, size) = (trainer.gpu(), trainer.size());
        let controller = if is_controlled {
            total(&controller_needs(&size))
        } else {
            0
        };
        let buffers = gpu.memory_by_name().into_iter();
        MemoryFigures {
            peak_bytes: gpu.memory_peak(),
            reserved_peak_bytes: gpu.memory_reserved_peak(),
            predicted_bytes: size.bytes() + controller,
            essential_bytes: size.essential_bytes(),
            splats_peak: size.splats,
            isects_peak: size.isects,
            buffers: buffers
                .filter(|(_, memory)| memory.peak_bytes > 0)
                .map(|(name, memory)| (name, memory.peak_bytes))
                .collect(),
        }
    }
}

/// Entry of a run's history: means over the steps since the entry before.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HistoryEntry {
    /// Steps done.
    pub iteration: u32,
    /// Wall time spent in training steps so far.
    pub seconds: f64,
    /// Splats at that time.
    pub splat_count: usize,
    /// Mean loss; `None` for NaN.
    pub loss: Option<f64>,
    /// Mean PSNR of the training views as drawn in these steps, decibels.
    pub psnr_db: Option<f64>,
    /// Means over the held-out views, if they were evaluated at that time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test: Option<MeanScore>,
}

/// Wall times of a run's parts in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Timings {
    /// Reading the data set and preparing the device.
    pub load_seconds: f64,
    /// Training steps, refinement included.
    pub train_seconds: f64,
    /// Writing checkpoints.
    pub checkpoint_seconds: f64,
    /// Rendering and scoring views.
    pub evaluate_seconds: f64,
}

impl Report {
    /// Comparison of this run with one that has this test PSNR in decibels; `None` if either has no test view.
    pub fn comparison(&self, psnr_db: Option<f64>) -> Option<RunComparison> {
        Some(RunComparison {
            splat_count: self.splat_count,
            better_db: self.test.psnr_db? - psnr_db?,
        })
    }

    /// Writes the report as JSON, atomically.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self);
        write_atomically(path, |file| writeln!(file, "{}", text?))
    }
}
