//! `ashfall stress`: the stability suite on the user's device and scene.

use super::Outcome;
use super::args::DeviceArgs;
use super::engine;
use super::interrupt::Interrupt;
use super::output::{Output, write_text};
use super::render::orbit;
use super::scene::SceneArgs;
use crate::gpu::Gpu;
use crate::io::splats::readable;
use crate::lab::bench::record;
use crate::lab::page::{Fact, number};
use crate::lab::stress::outcome::{CheckGroup, StressCheck, StressReport};
use crate::lab::stress::page;
use crate::lab::stress::{self, StressPlan, StressScene};
use crate::train::TrainConfig;
use crate::{Error, Result};
use clap::Args;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Test numerical stability on this device and a scene
///
/// Tests the operations that every kernel relies on (atomic and subgroup operations, exponentials over their whole
/// range, long loops, forward progress), then draws and trains at the limits: degenerate scenes and cameras, NaN and
/// infinities in every parameter, pictures of 1 x 1 to 16385 x 1, needles, zoom, a near plane amid the scene, scenes
/// far from the origin; gradients against exact ones, and repeated frames and steps, to the bit. Every check has a
/// bound and a measurement; a broken bound ends the command with exit code 1.
///
/// Writes stress.html, one file without references to others: the checks, and the sweeps as curves and pictures.
/// Without a scene it takes a built-in one.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct StressArgs {
    #[arg(value_name = "SCENE", help = format!(
        "The scene to try, {}; of a large one 50,000 splats are taken, spread over all",
        readable()
    ))]
    scene: Option<PathBuf>,
    /// Folder for the page, made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/stress")]
    out: PathBuf,
    /// Write checks and sweeps to this file, as one JSON object
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Few steps and small pictures, in seconds
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall stress
  ashfall stress run/scene.ply --json stress.json
  ashfall stress --device 0 --out out/stress-of-the-other-device";

/// Views of a user's scene.
const VIEWS: u32 = 3;

pub(super) fn run(args: &StressArgs) -> Result<Outcome> {
    let output = Output { json: false };
    let started = Instant::now();
    let interrupt = Interrupt::listen()?;
    let (subject, name) = subject(args.scene.as_deref(), args.scene_options)?;
    let gpu = engine::open(&args.device)?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    let plan = match args.quick {
        true => StressPlan::QUICK,
        false => StressPlan::USUAL,
    };
    let bar = output.bar(CheckGroup::ALL.len() as u64, "stress");
    let mut begun = 0;
    let found = stress::run(&gpu, &subject, plan, &mut |group| {
        bar.set_position(begun);
        bar.set_message(group.title());
        begun += 1;
        match interrupt.is_requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    bar.finish_and_clear();
    engine::check(&gpu)?;
    let Some(mut found) = found else {
        return Ok(Outcome::Interrupted);
    };
    // The suite's own facts come last.
    found.facts.splice(0..0, facts(&gpu, &subject, name, started));
    let page = write(&found, &args.out, args.json.as_deref())?;
    let (failed, count) = (found.failed(), found.outcomes.len());
    let mut lines: Vec<String> = failed.iter().copied().map(line).collect();
    lines.push(format!("{} of {count} checks keep their bounds", count - failed.len()));
    lines.push(format!("Look at {}", page.display()));
    output.result(lines.join("\n"), || unreachable!());
    verdict(&found)
}

/// Tested scene and its name.
fn subject(path: Option<&Path>, options: SceneArgs) -> Result<(StressScene, String)> {
    let Some(path) = path else {
        let subject = StressScene::made();
        let name = format!("built in, {} splats", subject.splats.len());
        return Ok((subject, name));
    };
    let splats = options.read(path)?.splats;
    if splats.is_empty() {
        return Err(Error::file(path, "there are no splats to try"));
    }
    let cameras = orbit::orbit_of_splats(&splats, Some(VIEWS));
    let near = orbit::radius(&splats) * f64::from(TrainConfig::default().near_factor);
    let subject = StressScene::of(&splats, &cameras, orbit::center(&splats), near);
    let name = format!("{}, {} splats", path.display(), splats.len());
    Ok((subject, name))
}

/// Facts at the top of the page.
fn facts(gpu: &Gpu, subject: &StressScene, scene: String, started: Instant) -> Vec<Fact> {
    let caps = gpu.caps();
    let camera = subject.camera();
    let views = format!(
        "{} views of {} × {}, {} splats of degree {}",
        subject.cameras.len(),
        camera.width,
        camera.height,
        subject.splats.len(),
        subject.splats.sh_degree
    );
    [
        ("device", caps.name.clone()),
        ("driver", caps.driver.clone()),
        ("scene", scene),
        ("drawn", views),
        ("date", record::today()),
        ("version", format!("ashfall {}", env!("CARGO_PKG_VERSION"))),
        ("took", format!("{:.0} s", started.elapsed().as_secs_f64())),
    ]
    .into_iter()
    .map(|(name, value)| (name.to_owned(), value))
    .collect()
}

/// Writes the page and the optional JSON; returns the page's path.
fn write(found: &StressReport, folder: &Path, json: Option<&Path>) -> Result<PathBuf> {
    let path = folder.join("stress.html");
    write_text(&path, &page::html(found)?)?;
    if let Some(json) = json {
        let text = found
            .json()
            .map_err(|error| Error::Config(format!("the report: {error}")))?;
        write_text(json, &(text + "\n"))?;
    }
    Ok(path)
}

/// A check in a line.
fn line(check: &StressCheck) -> String {
    format!(
        "FAILED: {}: {}: {} {}, bound {}",
        check.group.title(),
        check.name,
        number(check.measured),
        check.unit,
        number(check.bound)
    )
}

/// Error for a broken bound: the device, the driver or the engine is wrong.
fn verdict(found: &StressReport) -> Result<Outcome> {
    let failed = found.failed();
    match failed.as_slice() {
        [] if !found.outcomes.is_empty() => Ok(Outcome::Done),
        [] => Err(Error::Config("nothing was checked".into())),
        [first, ..] => Err(Error::Config(format!(
            "{} of {} checks failed; the first: {}",
            failed.len(),
            found.outcomes.len(),
            first.name
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_check_is_an_error_after_the_page_is_written() -> Result<()> {
        let found = |measured: f64| StressReport {
            outcomes: vec![
                StressCheck::at_most(CheckGroup::Device, "atomics", "", [0.0, 0.0], "wrong words"),
                StressCheck::at_most(CheckGroup::Sizes, "1 × 1", "", [measured, 1e-4], "of 1"),
            ],
            ..StressReport::default()
        };
        assert_eq!(verdict(&found(1e-5))?, Outcome::Done);
        for measured in [2e-4, f64::NAN] {
            let message = verdict(&found(measured)).err().map(|error| error.to_string());
            let expected = "1 of 2 checks failed; the first: 1 × 1";
            assert_eq!(message.as_deref(), Some(expected));
        }
        assert!(verdict(&StressReport::default()).is_err());
        let dir = tempfile::tempdir().map_err(Error::io(Path::new("a temporary folder")))?;
        let json = dir.path().join("stress.json");
        let page = write(&found(1.0), dir.path(), Some(&json))?;
        let html = std::fs::read_to_string(&page).map_err(Error::io(&page))?;
        assert!(html.contains("1 of 2 checks failed"));
        let text = std::fs::read_to_string(&json).map_err(Error::io(&json))?;
        assert!(text.contains("\"passed\": false"));
        Ok(())
    }
}
