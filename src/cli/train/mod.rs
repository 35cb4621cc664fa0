//! `ashfall train`: photographs in; a scene, a report and pictures out.

mod exposures;
mod needs;
mod poses;
mod results;
mod state;
mod steps;
mod transients;

use super::args::{DataArgs, DeviceArgs, check_capture};
use super::engine;
use super::interrupt::Interrupt;
use super::output::{Output, grouped};
use super::predict::Prediction;
use super::{Outcome, parse};
use crate::gpu::Gpu;
use crate::io::FolderLock;
use crate::lab::report::{MemoryFigures, Report};
use crate::render::Evaluator;
use crate::scene::{Dataset, Point, Split};
use crate::simplify::{AutoRun, CountController, for_auto_count};
use crate::train::{BufferLimits, ExposureModel, TrainConfig, TrainSize};
use crate::{Error, Result, io};
use clap::Args;
use glam::DVec3;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::configure::ConfigArgs;
pub(super) use state::RunState;

use state::absolute;
use steps::run_steps;

/// Fit splats to the photographs of a data set
///
/// Writes to DIR: scene.ply (the scene, readable by the usual viewers), report.json (every figure and
/// constant), checkpoint and run.json (to go on from), and test/*.png: photograph | rendering | fourfold
/// difference of each held-out view; with --exposure also exposures.json, with
/// --refine-poses refined/ and poses.json, with --against transients ignored/ and transients.json.
///
/// DATA is a folder with a COLMAP model (sparse/0 or sparse, binary or text) and images/, or with
/// a transforms.json (nerfstudio, Blender), a .csv of RealityCapture's cameras or an .xml of
/// Metashape's, or such a file.
///
/// Ctrl-C stops after the current step; `ashfall train --resume DIR` goes on and ends with the same
/// bytes as an uninterrupted run.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct TrainArgs {
    /// The data set; with --resume only if it has moved
    #[arg(value_name = "DATA", required_unless_present = "resume")]
    data: Option<PathBuf>,
    /// Folder for the results, made if it is not there
    #[arg(long, value_name = "DIR", required_unless_present = "resume")]
    out: Option<PathBuf>,
    /// Resume the run in DIR with its own options
    #[arg(long, value_name = "DIR",
          conflicts_with_all = ["out", "init", "overwrite", "ConfigArgs", "DataArgs"])]
    resume: Option<PathBuf>,
    /// Begin anew even if DIR holds an unfinished run
    #[arg(long)]
    overwrite: bool,
    /// Train to no more splats than the scene needs: fewer would cost held-out training views more than LOSS decibels
    /// of PSNR, or a twentieth of it in SSIM [default: 0.1]
    #[arg(long, value_name = "LOSS", num_args = 0..=1, default_missing_value = "0.1", value_parser = parse::loss,
          conflicts_with = "resume")]
    parsimony: Option<f64>,
    /// With --parsimony: compare splats and decibels with the run of this report.json
    #[arg(long, value_name = "REPORT")]
    compare: Option<PathBuf>,
    /// Begin with the points of this file instead of the data set's: a .ply point cloud, or an .obj mesh
    /// (points spread over its surface)
    #[arg(long, value_name = "FILE")]
    init: Option<PathBuf>,
    /// Steps between checkpoints; 0: only at the end
    #[arg(long, value_name = "N", default_value_t = 500)]
    checkpoint_every: u32,
    /// Steps between evaluations on the held-out views, kept in report.json's history; 0: only at the end
    #[arg(long, value_name = "N", default_value_t = 0)]
    eval_every: u32,
    /// Print JSON lines instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall train photos/ --out run/
  ashfall train photos/ --out run/ --iterations 7000 --downscale 2
  ashfall train photos/ --out run/ --strategy mcmc --max-splats 100000
  ashfall train photos/ --out run/ --mode mip --against floaters
  ashfall train transforms.json --out run/ --background white --set adc.grad_threshold=4e-4
  ashfall train --resume run/";

/// Points sampled on the mesh of --init.
const MESH_POINTS: usize = 100_000;

pub(super) fn run(args: &TrainArgs) -> Result<Outcome> {
    let output = Output { json: args.json };
    let (dir, mut state, lock) = begin(args)?;
    let against = args.compare.as_deref().map(needs::read).transpose()?;
    let start = Instant::now();
    let mut dataset = state.options.open(&state.data, true)?;
    if let Some(init) = &state.init {
        let origin = dataset.origin;
        dataset.set_origin(DVec3::ZERO);
        dataset.set_points(points(init)?);
        dataset.set_origin(origin);
    }
    let gpu = engine::open(&args.device)?;
    if args.resume.is_none() {
        let found = check_capture(&state.data, &dataset)?;
        dataset.warnings.extend(found);
    }
    let mut run = match &args.resume {
        Some(_) => AutoRun::resume(&gpu, &dataset, &dir.join("checkpoint"))?,
        None => new_run(args, &gpu, &dataset)?,
    };
    // All checks come before the first write.
    std::fs::create_dir_all(&dir).map_err(Error::io(&dir))?;
    let _lock = lock.map_or_else(|| FolderLock::take(&dir), Ok)?;
    io::atomic::remove_leftovers(&dir);
    state.iterations = run.end();
    state.rewind(run.iteration());
    if args.resume.is_none() {
        state.warnings = dataset.warnings.clone();
        run.save(&dir.join("checkpoint"))?;
        state.write(&dir)?;
    }
    state.timings.load_seconds += start.elapsed().as_secs_f64();
    announce(output, &gpu, &dataset, &run, &state);
    if let Some(gains) = run.exposure()? {
        output.remark(exposures::line(&gains));
    }
    let session = Session {
        gpu: &gpu,
        dataset: &dataset,
        dir: &dir,
        checkpoint_every: args.checkpoint_every,
        eval_every: args.eval_every,
        against: against.as_ref(),
        output,
    };
    session.run(run, &mut state)
}

fn new_run<'a>(args: &TrainArgs, gpu: &Gpu, dataset: &'a Dataset) -> Result<AutoRun<'a>> {
    let kind = gpu.caps().kind;
    let Some(loss_db) = args.parsimony else {
        let config = args.config.config_from(kind, |usual| usual.for_dataset(dataset))?;
        return AutoRun::new(gpu, dataset, config.within(dataset, BufferLimits::of(gpu)));
    };
    check_parsimony(gpu, dataset, &args.config.config(kind)?)?;
    let config = args.config.config_from(kind, |mut usual| {
        usual.auto.loss_db = loss_db;
        for_auto_count(usual, dataset.views_per_point())
    })?;
    let is_open = args.config.iterations.is_none();
    AutoRun::new(gpu, dataset, config)?.controlled(|trainer, dataset| CountController::begin(trainer, dataset, is_open))
}

/// Refuses inputs and options that exclude `--parsimony`.
fn check_parsimony(gpu: &Gpu, dataset: &Dataset, asked: &TrainConfig) -> Result<()> {
    if asked.refine_poses {
        let what =
            "--refine-poses and --parsimony exclude each other: held-out views keep poses that do not fit the rest";
        return Err(Error::Config(what.into()));
    }
    if asked.exposure != ExposureModel::Off {
        let what = "--exposure and --parsimony exclude each other: held-out views have no gains to be judged by";
        return Err(Error::Config(what.into()));
    }
    if asked.ignore_transients {
        let what =
            "--against transients and --parsimony exclude each other: passers-by in held-out views count as errors";
        return Err(Error::Config(what.into()));
    }
    let size = TrainSize::of(dataset, asked, BufferLimits::of(gpu), 1);
    if size.row_bands().count() > 1 || size.bytes() > gpu.memory_limit() {
        let [width, height] = size.image;
        return Err(Error::Config(format!(
            "--parsimony draws whole photographs, and one of {width}x{height} takes bands of rows within this device \
             and memory limit: leave it out, or reduce the photographs with --downscale"
        )));
    }
    Ok(())
}

/// Folder and state of the run, from the command line or from the resumed run; and the folder's lock, if a run has been
/// there.
fn begin(args: &TrainArgs) -> Result<(PathBuf, RunState, Option<FolderLock>)> {
    if let Some(dir) = &args.resume {
        let mut state = RunState::read(dir)?;
        let lock = FolderLock::take(dir)?;
        if let Some(data) = &args.data {
            state.data = absolute(data)?;
        }
        return Ok((dir.clone(), state, Some(lock)));
    }
    let (Some(data), Some(out)) = (&args.data, &args.out) else {
        return Err(Error::Config("DATA and --out are needed".into()));
    };
    let has_run = out.join("run.json").exists();
    let lock = has_run.then(|| FolderLock::take(out)).transpose()?;
    if !args.overwrite {
        refuse_unfinished(out)?;
    }
    let mut state = begin_made(data, &args.options, 0)?;
    state.init = args.init.as_deref().map(absolute).transpose()?;
    Ok((out.clone(), state, lock))
}

/// State of a new run.
pub(super) fn begin_made(data: &Path, options: &DataArgs, iterations: u32) -> Result<RunState> {
    let mut options = options.clone();
    options.images = options.photo_folder(data)?;
    Ok(RunState {
        data: absolute(data)?,
        options,
        iterations,
        ..RunState::default()
    })
}

fn refuse_unfinished(dir: &Path) -> Result<()> {
    match RunState::read(dir) {
        Ok(old) if !old.is_finished && old.iteration > 0 => Err(Error::Config(format!(
            "{dir} holds a run interrupted at iteration {} of {}: go on with `ashfall train --resume \
             {dir}`, or begin anew with --overwrite",
            old.iteration,
            old.iterations,
            dir = dir.display()
        ))),
        _ => Ok(()),
    }
}

/// Initial points from a file.
fn points(path: &Path) -> Result<Vec<Point>> {
    let extension = path.extension().map(|e| e.to_ascii_lowercase());
    let mut points = match extension.as_deref().and_then(|e| e.to_str()) {
        Some("obj") => io::obj::sample(&io::obj::read(path)?, MESH_POINTS, 0),
        Some("ply") => io::ply::read_points(path)?,
        _ => {
            return Err(Error::file(path, "first points come from a .ply or an .obj file"));
        }
    };
    let mut warnings = Vec::new();
    io::dataset::keep_finite(path, &mut points, &mut warnings);
    for warning in &warnings {
        eprintln!("warning: {warning}");
    }
    match points.is_empty() {
        true => Err(Error::file(path, "holds no points to begin with")),
        false => Ok(points),
    }
}

/// Measures of a run against overfitting few views.
fn against_overfitting(config: &TrainConfig) -> Vec<String> {
    let mut measures = Vec::new();
    if config.drop_rate > 0.0 {
        let percent = 100.0 * config.drop_rate;
        measures.push(format!("each step leaves out up to {percent:.0} % of the splats"));
    }
    let usual = TrainConfig::for_iterations(config.iterations).with_kind(config.kind);
    let weight = config.geometry.normal;
    if weight > usual.geometry.normal {
        measures.push(format!("normals follow depths with weight {weight:.3}"));
    }
    measures
}

fn announce(output: Output, gpu: &Gpu, dataset: &Dataset, run: &AutoRun<'_>, state: &RunState) {
    let trainer = run.trainer();
    let prediction = Prediction::of(trainer.size(), trainer.splats_expected(), run.controller().is_some());
    let config = run.config();
    let train = dataset.split(Split::Train).len();
    let test = dataset.split(Split::Test).len();
    let part = match state.iteration {
        0 => format!("{} iterations", grouped(config.iterations as usize)),
        done => format!("iteration {} of {}", grouped(done as usize), config.iterations),
    };
    output.remark(format_args!(
        "{} · {train} training views, {test} test views, {} points · {part}",
        gpu.caps().name,
        grouped(dataset.points.len()),
    ));
    let measures = against_overfitting(config);
    if !measures.is_empty() {
        output.remark(format_args!(
            "a point lies in {} training images (median): {}",
            dataset.views_per_point(),
            measures.join(", ")
        ));
    }
    if state.iteration < config.coarse_until {
        output.remark(format_args!(
            "coarse to fine: photographs start at 1/{} of their width and height, and are whole from iteration {} on",
            1 << config.coarse_halvings,
            config.coarse_until + 1
        ));
    }
    output.remark(prediction.line(gpu.memory_limit()));
    output.event(|| {
        json!({
            "event": "start",
            "device": gpu.caps().name,
            "train_views": train,
            "test_views": test,
            "points": dataset.points.len(),
            "iteration": state.iteration,
            "memory": prediction.value(),
            "config": config,
        })
    });
}

/// A run with all inputs, from the first step to the report.
pub(super) struct Session<'a> {
    pub gpu: &'a Gpu,
    pub dataset: &'a Dataset,
    /// The folder of the results; must exist.
    pub dir: &'a Path,
    /// Steps between checkpoints; 0: only at the end.
    pub checkpoint_every: u32,
    /// Steps between evaluations on the held-out views; 0: only at the end.
    pub eval_every: u32,
    /// The report of a run to compare with.
    pub against: Option<&'a Report>,
    pub output: Output,
}

impl<'a> Session<'a> {
    /// Trains to the end and writes the results, or to an interruption and prints how to resume.
    pub(crate) fn run(&self, mut run: AutoRun<'_>, state: &mut RunState) -> Result<Outcome> {
        let interrupt = Interrupt::listen()?;
        let outcome = run_steps(self, &mut run, state, &interrupt).inspect_err(|_| {
            let dir = self.dir.display();
            let advice = format_args!("the last checkpoint stands: ashfall train --resume {dir}");
            self.output.remark(advice);
        })?;
        engine::check(self.gpu)?;
        if outcome == Outcome::Interrupted {
            let (dir, iteration) = (self.dir.display(), state.iteration);
            self.output.result(
                format_args!(
                    "interrupted after iteration {iteration} of {}; go on with: ashfall train --resume {dir}",
                    state.iterations
                ),
                || json!({"event": "interrupted", "iteration": iteration, "dir": self.dir}),
            );
            return Ok(outcome);
        }
        let (splats, memory) = (
            run.splats()?,
            MemoryFigures::of(run.trainer(), run.controller().is_some()),
        );
        if let Some(gains) = run.exposure()? {
            exposures::write(self.dir, self.dataset, &gains)?;
        }
        if let Some(poses) = run.poses()? {
            let (line, summary) = poses::write(self.dir, &state.data, self.dataset, poses)?;
            self.output.remark(line);
            self.output.event(|| json!({"event": "poses", "poses": summary}));
        }
        let mut ignored = None;
        if let Some(patches) = run.transients()? {
            let (line, summary) = transients::write(self.dir, self.dataset, patches)?;
            self.output.remark(line);
            ignored = summary["share"].as_f64();
            self.output
                .event(|| json!({"event": "transients", "transients": summary}));
        }
        let refined = run.refined_dataset()?;
        let session = Session {
            dataset: refined.as_ref().unwrap_or(self.dataset),
            ..*self
        };
        let config = run.config().clone();
        let controller = run.controller();
        let found = controller.map(|controller| needs::found(self.dataset, controller.history(), &splats));
        drop(run);
        results::write(&session, &config, state, (&splats, memory), (found, ignored))?;
        Ok(Outcome::Done)
    }

    /// Evaluator of the views of a split.
    fn evaluator(&self, config: &TrainConfig, split: Split) -> Evaluator<'a> {
        let views = self.dataset.split(split);
        let background = config.evaluation_background();
        engine::evaluator(self.gpu, self.dataset, &views, background)
    }
}
