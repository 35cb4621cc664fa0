//! `ashfall bench`: speed of kernels, frames, training steps and guests' pictures on a device.

mod budget;
mod growth;
mod guest;

use super::Outcome;
use super::args::DeviceArgs;
use super::engine;
use super::output::write_text;
use crate::lab::baseline::{self, Ratio, TARGET_FEATURES};
use crate::lab::bench::budget::StepBudget;
use crate::lab::bench::frame::Scaling;
use crate::lab::bench::guest::GuestCost;
use crate::lab::bench::train::TrainMemory;
use crate::lab::bench::{self, Bench, BenchOptions, BenchRow, record};
use crate::{Error, Result};
use clap::{Args, Subcommand};
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;

/// Measure the device
///
/// Kernels one by one, whole frames and training steps by their size, or pictures in a host's commands.
#[derive(Clone, Debug, Args)]
pub(super) struct BenchArgs {
    #[command(subcommand)]
    command: BenchCommand,
}

#[derive(Clone, Debug, Subcommand)]
enum BenchCommand {
    Kernels(KernelsArgs),
    Frame(growth::BenchFrameArgs),
    Train(growth::BenchTrainArgs),
    Guest(guest::BenchGuestArgs),
}

/// Every kernel in every variant and workgroup, and baselines
///
/// Every result is compared with the reference before it is timed; a wrong one ends the run, with exit code 1.
///
/// Times are device timestamps, reported as median and median absolute deviation, with the processor time of the
/// process beside them. Rates are in the unit of each kernel, and for memory-bound kernels also a share of the rate of
/// a copy on the device. The last lines are ratios of the chosen kernels to the 16×16 tile design on the same device
/// and to renderers and a sort on the processor, all measured in turns.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
struct KernelsArgs {
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Selection, repetitions and output files.
#[derive(Clone, Debug, Args)]
pub(super) struct OutputArgs {
    /// Only cases with this text in their name, `bench/input/variant`: `rasterize/small`, `subgroup`, `baseline/sort`,
    /// `frame/1000000`, `1920x1080`
    #[arg(long, value_name = "TEXT")]
    pub filter: Option<String>,
    /// Runs of each that count
    #[arg(long, value_name = "N", default_value_t = BenchOptions::default().runs,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=10_000))]
    pub runs: usize,
    /// Write the rows to this file, as CSV
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write rows, ratios and exponents to this file, as one JSON object
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// File the rows under the device's name and today's date in a folder, besides other measurements
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "benches/record")]
    pub record: Option<PathBuf>,
}

const EXAMPLES: &str = "\
Examples:
  ashfall bench kernels
  ashfall bench kernels --filter sort --runs 7 --csv sort.csv
  ashfall bench kernels --filter baseline --json baselines.json";

pub(super) fn run(args: &BenchArgs) -> Result<Outcome> {
    match &args.command {
        BenchCommand::Kernels(args) => kernels(args),
        BenchCommand::Frame(args) => growth::frame(args),
        BenchCommand::Train(args) => growth::train(args),
        BenchCommand::Guest(args) => guest::run(args),
    }
}

/// All results as one JSON object.
#[derive(Default, Serialize)]
struct Report<'a> {
    device: &'a str,
    driver: &'a str,
    /// Vector instructions that the compiler was allowed to use.
    #[serde(skip_serializing_if = "Option::is_none")]
    target_features: Option<&'static str>,
    rows: &'a [BenchRow],
    /// Comparisons with the baselines.
    #[serde(skip_serializing_if = "Option::is_none")]
    ratios: Option<&'a [Ratio]>,
    #[serde(flatten)]
    scaling: Option<&'a Scaling>,
    /// Device memory of training, measured and by the formula.
    #[serde(skip_serializing_if = "<[TrainMemory]>::is_empty")]
    memory: &'a [TrainMemory],
    /// Least times of the stages of training by published limits.
    #[serde(skip_serializing_if = "<[StepBudget]>::is_empty")]
    budgets: &'a [StepBudget],
    /// Pictures in a host's commands.
    #[serde(skip_serializing_if = "<[GuestCost]>::is_empty")]
    guests: &'a [GuestCost],
}

impl OutputArgs {
    /// Opens the device and a bench on it.
    fn open(&self, name: &'static str, device: &DeviceArgs) -> Result<Bench> {
        let gpu = engine::open(device)?;
        eprintln!("{}", gpu.caps().name);
        let options = BenchOptions {
            filter: self.filter.clone(),
            runs: self.runs,
            ..BenchOptions::default()
        };
        let progress = |row: &BenchRow| {
            if row.stage == "total" {
                eprintln!("measured {} {}", row.input, row.variant);
            }
        };
        Bench::new(name, &gpu, options, progress)
    }

    /// Error of a filter that selects nothing.
    fn selects_nothing(&self) -> Error {
        let filter = self.filter.as_deref().unwrap_or_default();
        Error::Config(format!("nothing is called {filter:?}"))
    }

    /// Prints the table and `more`, and writes the files of the options.
    fn finish(&self, bench: &Bench, more: impl IntoIterator<Item = String>, report: Report<'_>) -> Result<Outcome> {
        let mut out = std::io::stdout().lock();
        // Rows of bytes have no times.
        let timed = bench.rows.iter().filter(|row| row.runs > 0);
        for line in timed.map(BenchRow::line).chain(more) {
            // A closed pipe is not an error.
            _ = writeln!(out, "{line}");
        }
        if let Some(path) = &self.csv {
            write_text(path, &bench::row::csv(&bench.rows)?)?;
        }
        let caps = bench.gpu().caps();
        if let Some(path) = &self.json {
            let report = Report {
                device: &caps.name,
                driver: &caps.driver,
                rows: &bench.rows,
                ..report
            };
            let text =
                serde_json::to_string_pretty(&report).map_err(|error| Error::Config(format!("the report: {error}")))?;
            write_text(path, &(text + "\n"))?;
        }
        if let Some(folder) = &self.record {
            let path = record::write(folder, &caps.name, &bench.rows)?;
            eprintln!("{}", path.display());
        }
        engine::check(bench.gpu())?;
        Ok(Outcome::Done)
    }
}

fn kernels(args: &KernelsArgs) -> Result<Outcome> {
    let mut bench = args.output.open("kernels", &args.device)?;
    bench::kernels::run(&mut bench)?;
    let ratios = baseline::run(&mut bench)?;
    // The copy is measured in any case.
    let filter = args.output.filter.as_deref().unwrap_or_default();
    let asked = |row: &BenchRow| format!("kernels/{}/{}", row.input, row.variant).contains(filter);
    if !bench.rows.iter().any(asked) {
        return Err(args.output.selects_nothing());
    }
    let report = Report {
        target_features: Some(TARGET_FEATURES),
        ratios: Some(&ratios),
        ..Report::default()
    };
    args.output.finish(&bench, ratios.iter().map(Ratio::line), report)
}
