//! `ashfall bench frame` and `ashfall bench train`: whole frames and steps by size.

use super::{OutputArgs, Report, budget};
use crate::Result;
use crate::cli::Outcome;
use crate::cli::args::{DataArgs, DeviceArgs};
use crate::cli::configure::KindArg;
use crate::cli::output::{bytes, grouped};
use crate::cli::parse;
use crate::cli::render::orbit::{orbit_of_splats, radius};
use crate::cli::scene::SceneArgs;
use crate::io::splats::readable;
use crate::lab::bench::Bench;
use crate::lab::bench::budget::{PUBLISHED, PublishedLimits};
use crate::lab::bench::frame::{self, FramePlan, Scaling, ScalingPoint};
use crate::lab::bench::growth::Exponent;
use crate::lab::bench::train::{self, TrainMemory, TrainPlan};
use crate::scene::{Camera, Primitive, Splats};
use crate::train::TrainConfig;
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::path::{Path, PathBuf};

/// Whole frames by number of splats and size of the picture
///
/// Without SCENE the splats are made: a volume before the camera in which every pixel lies under as many splats as
/// in trained scenes, however many there are (σ ∝ 1/√N), with harmonics of degree 3. A frame is recorded, submitted,
/// waited for and read back; stages are the device's by its timestamps, `host` is the rest of the wall time. A scene
/// too large for the device is listed with its error. At the end stand the exponents of time over splats and over
/// pixels (least squares of the logarithms, 95 % interval), the largest cost of doubling, the memory of every buffer,
/// and the cost of one splat over the whole picture among the others (the most measured, up to a million).
#[derive(Clone, Debug, Args)]
#[command(after_help = FRAME_EXAMPLES)]
pub(super) struct BenchFrameArgs {
    #[arg(value_name = "SCENE", help = format!(
        "A scene to draw instead, {}, from the first camera of an orbit; sampled to each number of splats",
        readable()
    ))]
    scene: Option<PathBuf>,
    /// Numbers of splats [default: 10,000 to 4,000,000; of a SCENE: its own]
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = parse::count)]
    splats: Vec<usize>,
    /// Sizes of the picture [default: 480x270,960x540,1920x1080,3840x2160]
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', value_parser = parse::image_size)]
    sizes: Vec<[u32; 2]>,
    /// Degree of the harmonics of splats that are made, 0 to 3
    #[arg(long, value_name = "D", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=3))]
    sh_degree: u32,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const FRAME_EXAMPLES: &str = "\
Examples:
  ashfall bench frame --runs 7
  ashfall bench frame --splats 200000 --sizes 480x270,1920x1080 --csv frames.csv
  ashfall bench frame run/scene.ply --sizes 1920x1080";

/// Whole training steps by number of splats
///
/// On the photographs of DATA, from its points or from --init, sampled to exactly each number of splats; without
/// refinement, so that the number stays. `step` is wall time and processor time (user and system) of the whole
/// process per step in a run of them, `alone` the device's stages of single ones, means of four.
#[derive(Clone, Debug, Args)]
#[command(after_help = TRAIN_EXAMPLES)]
pub(super) struct BenchTrainArgs {
    /// The data set
    #[arg(value_name = "DATA")]
    data: PathBuf,
    #[arg(long, value_name = "SCENE", help = format!(
        "Begin with the splats of this scene, {}, instead of the data set's points",
        readable()
    ))]
    init: Option<PathBuf>,
    /// Numbers of splats [default: 50000,200000]
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = parse::count)]
    splats: Vec<usize>,
    /// Timed steps, in as many parts as --runs
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
    /// Steps before them
    #[arg(long, value_name = "N", default_value_t = 100)]
    warm_up: u32,
    /// Degree of the harmonics, 0 to 3
    #[arg(long, value_name = "D", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=3))]
    sh_degree: u32,
    /// Kind of splats from the data set's points [default: 3d]; a scene has its own
    #[arg(long, value_name = "KIND", conflicts_with = "init")]
    kind: Option<KindArg>,
    /// Print each stage's bytes and operations, and the least time they take by the published limits of these devices
    #[arg(long, value_name = "DEVICE,…", value_delimiter = ',', value_parser = published())]
    budget: Vec<PublishedLimits>,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const TRAIN_EXAMPLES: &str = "\
Examples:
  ashfall bench train photos/ --runs 10
  ashfall bench train photos/ --downscale 2 --splats 10000,20000,50000,100000 --json steps.json
  ashfall bench train photos/ --init run/scene.ply --splats 50000
  ashfall bench train photos/ --splats 1000000 --budget h100,rtx4090";

/// Parser of the names of devices with published limits.
fn published() -> impl TypedValueParser<Value = PublishedLimits> {
    let names = PUBLISHED.map(|limits| PossibleValue::new(limits.name).help(limits.product));
    PossibleValuesParser::new(names).try_map(|name| PublishedLimits::named(&name).ok_or("no such device"))
}

pub(super) fn frame(args: &BenchFrameArgs) -> Result<Outcome> {
    let mut bench = args.output.open("frame", &args.device)?;
    let scene = scene_of(args.scene.as_deref(), &args.scene_options)?;
    let usual = match &scene {
        Some((splats, ..)) => vec![splats.len()],
        None => frame::SPLATS.to_vec(),
    };
    let plan = FramePlan {
        splats: either(&args.splats, usual),
        sizes: either(&args.sizes, frame::SIZES.to_vec()),
        sh_degree: args.sh_degree,
        scene,
    };
    let scaling = frame::run(&mut bench, &plan)?;
    finish(&args.output, &bench, &scaling, Default::default())
}

pub(super) fn train(args: &BenchTrainArgs) -> Result<Outcome> {
    let mut dataset = args.options.open(&args.data, true)?;
    let scene = match &args.init {
        Some(path) => Some(args.scene_options.read(path)?.splats),
        None => None,
    };
    if let Some(scene) = &scene {
        dataset.set_origin(scene.origin);
    }
    let mut bench = args.output.open("train", &args.device)?;
    let plan = TrainPlan {
        splats: either(&args.splats, train::SPLATS.to_vec()),
        steps: args.steps,
        warm_up: args.warm_up,
        sh_degree: args.sh_degree,
        kind: args.kind.map_or(Primitive::Gaussian3d, Primitive::from),
        scene,
        budgets: args.budget.clone(),
    };
    let costs = train::run(&mut bench, &dataset, &plan)?;
    let mut lines: Vec<String> = costs.scaling.points.iter().filter_map(step_line).collect();
    lines.extend(costs.memory.iter().map(memory_line));
    lines.extend(costs.budgets.iter().flat_map(budget::lines));
    let report = Report {
        memory: &costs.memory,
        budgets: &costs.budgets,
        ..Report::default()
    };
    finish(&args.output, &bench, &costs.scaling, (report, lines))
}

/// A scene with the first camera of an orbit and the near plane in world units.
pub(super) fn scene_of(path: Option<&Path>, options: &SceneArgs) -> Result<Option<(Splats, Camera, f32)>> {
    let Some(path) = path else {
        return Ok(None);
    };
    let splats = options.read(path)?.splats;
    let camera = orbit_of_splats(&splats, None).into_iter().next();
    let near = radius(&splats) * f64::from(TrainConfig::default().near_factor);
    Ok(camera.map(|camera| (splats, camera, near as f32)))
}

fn either<T: Clone>(asked: &[T], usual: Vec<T>) -> Vec<T> {
    match asked {
        [] => usual,
        asked => asked.to_vec(),
    }
}

fn finish<'a>(
    output: &OutputArgs,
    bench: &Bench,
    scaling: &'a Scaling,
    (report, mut lines): (Report<'a>, Vec<String>),
) -> Result<Outcome> {
    if scaling.points.is_empty() {
        return Err(output.selects_nothing());
    }
    lines.extend(scaling.points.iter().map(point_line));
    lines.extend(scaling.exponents.iter().map(Exponent::line));
    if let Some(giant) = &scaling.giant {
        let [low, high] = giant.interval;
        lines.push(format!(
            "a splat all over the picture among {} at {}x{}: {:.2} [{low:.2}, {high:.2}] times the frame without",
            grouped(giant.splats),
            giant.size[0],
            giant.size[1],
            giant.ratio
        ));
    }
    let report = Report {
        scaling: Some(scaling),
        ..report
    };
    output.finish(bench, lines, report)
}

/// A point's memory by buffer, or its error.
fn point_line(point: &ScalingPoint) -> String {
    let [width, height] = point.size;
    let name = format!("{} splats at {width}x{height}", grouped(point.splats));
    if let Some(fault) = &point.fault {
        return format!("{name}: not held by the device: {fault}");
    }
    let sum: u64 = point.memory.iter().map(|(_, size)| size).sum();
    let mut buffers = point.memory.clone();
    buffers.sort_by_key(|(_, size)| std::cmp::Reverse(*size));
    let buffers: Vec<String> = buffers
        .iter()
        .map(|(name, size)| format!("{name} {}", bytes(*size)))
        .collect();
    format!("{name}: {} ({})", bytes(sum), buffers.join(", "))
}

fn step_line(point: &ScalingPoint) -> Option<String> {
    let (wall, processor) = (point.wall_s?, point.processor_s?);
    Some(format!(
        "a step with {} splats: {wall:.4} s, {processor:.4} CPU-s",
        grouped(point.splats)
    ))
}

fn memory_line(memory: &TrainMemory) -> String {
    let share = |of: u64| memory.peak_bytes as f64 / of.max(1) as f64;
    format!(
        "memory with {} splats: {} at most, {:.3} of the prediction, {:.2} of parameters, moments, photographs \
         and lists alone",
        grouped(memory.splats),
        bytes(memory.peak_bytes),
        share(memory.predicted_bytes),
        share(memory.essential_bytes)
    )
}
