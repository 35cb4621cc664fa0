//! `ashfall bench guest`: pictures in a host's commands.

use super::{OutputArgs, Report};
use crate::Result;
use crate::cli::Outcome;
use crate::cli::args::DeviceArgs;
use crate::cli::bench::growth::scene_of;
use crate::cli::output::grouped;
use crate::cli::parse;
use crate::cli::scene::SceneArgs;
use crate::io::splats::readable;
use crate::lab::bench::frame::NEAR;
use crate::lab::bench::guest::{self, GuestCost, GuestPlan};
use crate::lab::bench::input::volume;
use clap::Args;
use std::path::PathBuf;

/// Pictures recorded into a host's commands, each kind relative to a plain one
///
/// Kinds, measured in turns: plain; over the host's pixels; behind a host's depth that hides nothing (`depth/none`) and
/// one that hides the farther half of the splats (`depth/half`); the same splats divided among instances; two eyes in
/// one command buffer. A frame is recorded, submitted and waited for; nothing is read back. Without SCENE the splats
/// are made, as by `bench frame`.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct BenchGuestArgs {
    #[arg(value_name = "SCENE", help = format!(
        "A scene to draw instead, {}, from the first camera of an orbit",
        readable()
    ))]
    scene: Option<PathBuf>,
    /// Number of splats [default: 200,000; of a SCENE: its own]
    #[arg(long, value_name = "N", value_parser = parse::count)]
    splats: Option<usize>,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1920x1080", value_parser = parse::image_size)]
    size: [u32; 2],
    /// Number of instances
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = parse::count)]
    instances: usize,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall bench guest --runs 11
  ashfall bench guest run/scene.ply --size 960x540 --filter depth --csv guests.csv";

/// Number of splats that are made.
const SPLATS: usize = 200_000;
/// Degree of their harmonics.
const SH_DEGREE: u32 = 3;

pub(super) fn run(args: &BenchGuestArgs) -> Result<Outcome> {
    let mut bench = args.output.open("guest", &args.device)?;
    let size @ [width, height] = args.size;
    let scene = scene_of(args.scene.as_deref(), &args.scene_options)?;
    let (splats, camera, near) = match scene {
        None => {
            let aspect = f64::from(height) / f64::from(width);
            let splats = volume::splats(args.splats.unwrap_or(SPLATS), SH_DEGREE, aspect, 1);
            (splats, volume::camera(size), NEAR)
        }
        Some((scene, camera, near)) => {
            let count = args.splats.unwrap_or(scene.len());
            (volume::exactly(&scene, count, 1), camera.with_size(width, height), near)
        }
    };
    let plan = GuestPlan {
        splats,
        camera,
        near,
        instances: args.instances,
    };
    let costs = guest::run(&mut bench, &plan)?;
    if costs.is_empty() {
        return Err(args.output.selects_nothing());
    }
    let name = format!("{} splats at {width}x{height}", grouped(plan.splats.len()));
    let lines: Vec<String> = costs.iter().map(|cost| line(&name, cost)).collect();
    let report = Report {
        guests: &costs,
        ..Report::default()
    };
    args.output.finish(&bench, lines, report)
}

fn line(name: &str, cost: &GuestCost) -> String {
    let [low, high] = cost.interval;
    format!(
        "{name}, {}: {:.3} [{low:.3}, {high:.3}] times the plain picture",
        cost.variant, cost.ratio
    )
}
