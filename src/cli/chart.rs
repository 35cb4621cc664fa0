//! `ashfall chart`: speed against accuracy, on one page, every bound checked.

use super::Outcome;
use super::args::{DataArgs, DeviceArgs};
use super::engine;
use super::output::{Output, write_text};
use super::scene::{SceneArgs, fit_axes};
use crate::gpu::Gpu;
use crate::io::splats::readable;
use crate::lab::bench::record;
use crate::lab::chart::measure::{ChartPlan, measure};
use crate::lab::chart::{Chart, csv, page};
use crate::lab::page::Fact;
use crate::lab::synth::{self, Kind, SynthOptions};
use crate::scene::{Dataset, Splats, Split};
use crate::{Error, Result};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};

/// Chart speed against accuracy
///
/// Measures time and error for every setting of the options that trade one for the other: frames against an f64
/// reference without cuts, gradients against exact ones, training runs by held-out views over several seeds. Every
/// setting of rendering has a proven error bound, pixel by pixel; a broken bound ends the command with exit code 1.
/// On a made scene with known surfaces, meshes, depths and normals of 3D Gaussians and surfels are compared, too.
///
/// Writes chart.html, one file without references to others, and chart.csv with its numbers. Without a scene it
/// trains one; without a data set it makes one.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ChartArgs {
    #[arg(value_names = ["SCENE", "DATA"], num_args = 0..=2, help = format!(
        "The scene to draw, {}, and the data set it was trained on; or either: a scene alone has no cameras, so one \
         path is the data set",
        readable()
    ))]
    paths: Vec<PathBuf>,
    /// Folder for the page, made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/chart")]
    out: PathBuf,
    /// Few settings and tiny inputs, in seconds
    #[arg(long)]
    quick: bool,
    /// Only a part of it
    #[arg(long, value_name = "PART")]
    only: Option<ChartPart>,
    /// Steps of a training run [default: 300; quick: 20]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..))]
    iterations: Option<u32>,
    /// Training runs of each setting [default: 3; quick: 2]
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u64).range(1..))]
    seeds: Option<u64>,
    /// Repetitions of every timed frame and step [default: 15; quick: 2]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    runs: Option<u64>,
    /// Print the numbers as CSV
    #[arg(long)]
    csv: bool,
    /// File the numbers under DIR/<device>/<date>-chart.csv
    #[arg(long, value_name = "DIR", num_args = 0..=1, default_missing_value = "benches/record")]
    record: Option<PathBuf>,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall chart                                     a made scene, in a few minutes
  ashfall chart run/scene.ply photos/ --only accuracy
  ashfall chart photos/ --downscale 2 --iterations 2000 --seeds 5";

/// A part of the chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ChartPart {
    /// Frames and gradients
    Accuracy,
    /// Training runs
    Training,
    /// Geometry of training runs on a made scene
    Geometry,
}

pub(super) fn run(args: &ChartArgs) -> Result<Outcome> {
    let output = Output { json: false };
    let gpu = engine::open(&args.device)?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    let (scene, dataset, name) = subject(args, &gpu)?;
    let plan = plan(args);
    let mut said = |what: &str| output.remark(what);
    let mut chart = measure(&gpu, &dataset, scene.as_ref(), &plan, &mut said)?;
    engine::check(&gpu)?;
    chart.facts = facts(&gpu, &dataset, scene.as_ref(), &name, &plan);
    write(&chart, &args.out)?;
    let text = match args.csv {
        true => csv::csv(&chart).trim_end().to_owned(),
        false => format!("Look at {}", args.out.join("chart.html").display()),
    };
    output.result(text, || unreachable!());
    let outcome = verdict(&chart)?;
    if let Some(folder) = &args.record {
        let path = record::file(folder, &gpu.caps().name, "-chart.csv")?;
        write_text(&path, &csv::csv(&chart))?;
        output.remark(format_args!("Filed as {}", path.display()));
    }
    Ok(outcome)
}

/// Error for broken bounds: the proof or the engine is wrong.
fn verdict(chart: &Chart) -> Result<Outcome> {
    let broken = chart.broken();
    match broken.as_slice() {
        [] => Ok(Outcome::Done),
        [first, ..] => Err(Error::Config(format!(
            "{} of {} settings break their bounds; the first: {first}",
            broken.len(),
            chart.bounded()
        ))),
    }
}

/// Writes the page and its numbers.
fn write(chart: &Chart, folder: &Path) -> Result<()> {
    write_text(&folder.join("chart.html"), &page::html(chart)?)?;
    write_text(&folder.join("chart.csv"), &csv::csv(chart))
}

fn plan(args: &ChartArgs) -> ChartPlan {
    let usual = match args.quick {
        true => ChartPlan::QUICK,
        false => ChartPlan::USUAL,
    };
    let has = |part| args.only.is_none_or(|only| only == part);
    ChartPlan {
        iterations: args.iterations.unwrap_or(usual.iterations),
        seeds: args.seeds.unwrap_or(usual.seeds),
        runs: args.runs.map_or(usual.runs, |runs| runs as usize),
        with_accuracy: has(ChartPart::Accuracy),
        with_training: has(ChartPart::Training),
        // Its scene is made; a chart of one's own scene has it if asked for.
        with_geometry: has(ChartPart::Geometry) && (args.paths.is_empty() || args.only.is_some()),
        ..usual
    }
}

/// Scene, data set and name.
fn subject(args: &ChartArgs, gpu: &Gpu) -> Result<(Option<Splats>, Dataset, String)> {
    let (scene, data) = match args.paths.as_slice() {
        [] => return Ok((None, made(args.quick), "made in code".into())),
        [data] => (None, data),
        [scene, data, ..] => (Some(scene), data),
    };
    let mut dataset = args.options.open(data, true)?;
    let name = scene.unwrap_or(data).display().to_string();
    let Some(path) = scene else {
        return Ok((None, dataset, name));
    };
    let scene = args.scene_options.read(path)?;
    dataset.set_origin(scene.splats.origin);
    let splats = fit_axes(path, scene, gpu, &dataset, [0.0; 3])?;
    Ok((Some(splats), dataset, name))
}

/// The demo's scene.
fn made(is_quick: bool) -> Dataset {
    let usual = SynthOptions::default();
    let options = match is_quick {
        false => usual,
        true => SynthOptions {
            views: 8,
            width: 44,
            height: 33,
            samples: 1,
            points: 300,
            test_every: 4,
            ..usual
        },
    };
    synth::scene(Kind::Demo).dataset(&options)
}

/// Facts at the top of the page.
fn facts(gpu: &Gpu, dataset: &Dataset, scene: Option<&Splats>, name: &str, plan: &ChartPlan) -> Vec<Fact> {
    let views = dataset.split(Split::Test).len();
    let drawn = match scene {
        Some(splats) => format!("{} splats of degree {}", splats.len(), splats.sh_degree),
        None => format!("the first training run of {} steps", plan.iterations),
    };
    let size = dataset.views.first().map_or(String::new(), |view| {
        format!("{} × {}", view.camera.width, view.camera.height)
    });
    let mut rows = vec![
        ("scene", name.to_owned()),
        (
            "data set",
            format!("{} views, {views} held out, {size}", dataset.views.len()),
        ),
        ("device", gpu.caps().name.to_owned()),
        ("date", record::today()),
        ("version", format!("ashfall {}", env!("CARGO_PKG_VERSION"))),
    ];
    if plan.with_accuracy {
        rows.push(("drawn", drawn));
        let runs = format!("frames and steps {} times each, by the device's timestamps", plan.runs);
        rows.push(("timed", runs));
    }
    if plan.with_training {
        let runs = format!("{} runs a setting, {} steps by default", plan.seeds, plan.iterations);
        rows.push(("trained", runs));
    }
    rows.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::chart::FramePoint;

    #[test]
    fn a_broken_bound_is_an_error_after_the_page_is_written() -> Result<()> {
        let point = |excess: f64| FramePoint {
            excess,
            ..FramePoint::default()
        };
        let chart = |excess: f64| Chart {
            frames: vec![point(-1.0), point(excess)],
            ..Chart::default()
        };
        assert_eq!(verdict(&chart(-1.0))?, Outcome::Done);
        for excess in [1e-6, f64::NAN] {
            let message = verdict(&chart(excess)).err().map(|error| error.to_string());
            let message = message.unwrap_or_default();
            assert!(message.contains("1 of 2 settings break their bounds"), "{message}");
        }
        let dir = tempfile::tempdir().map_err(Error::io(Path::new("a temporary folder")))?;
        write(&chart(1.0), dir.path())?;
        let page = dir.path().join("chart.html");
        let html = std::fs::read_to_string(&page).map_err(Error::io(&page))?;
        assert!(html.contains("1 of 2 settings break their bounds"));
        Ok(())
    }
}
