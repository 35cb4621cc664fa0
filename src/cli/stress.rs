//! `ashfall stress`: the stability suite on the user's device and scene.

use super::Outcome;
use super::args::DeviceArgs;
use super::engine::Engine;
use super::eval::read_scene;
use super::interrupt::Interrupt;
use super::output::Output;
use super::render::orbit;
use crate::io::atomic::write_atomically;
use crate::lab::bench::record;
use crate::lab::stress::outcome::Stress;
use crate::lab::stress::page;
use crate::lab::stress::{self, Plan, Subject};
use crate::train::TrainConfig;
use crate::{Error, Result};
use clap::Args;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Try what breaks others, on this device and a scene
///
/// Asks the device whether it does what every kernel relies on (atomic and subgroup operations, exponentials over
/// their whole range, long loops, forward progress), then draws and trains where such programs fail: degenerate
/// scenes and cameras, numbers that are none in every parameter, pictures of 1 x 1 to 16385 x 1, needles, zoom, a
/// near plane amid the scene, scenes far from the origin; gradients against exact ones, and frames and steps once
/// more, to the bit. Every check states a bound and what was measured; one that fails ends the command with exit
/// code 1.
///
/// Writes stress.html, which needs no other file: the checks, and the sweeps as curves and pictures. Without a scene
/// it takes a built-in one.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct StressArgs {
    /// The scene to try, a .ply (or .splat) file; of a large one 50,000 splats are taken, spread over all
    #[arg(value_name = "SCENE.ply")]
    scene: Option<PathBuf>,
    /// Folder for the page, made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/stress")]
    out: PathBuf,
    /// Write checks and sweeps to this file, as one JSON object
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Few steps and small pictures: whether all works, in seconds
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall stress
  ashfall stress run/scene.ply --json stress.json
  ashfall stress --device 0 --out out/stress-of-the-other-device";

/// Views of a scene of the user's.
const VIEWS: u32 = 3;

pub(super) fn run(args: &StressArgs) -> Result<Outcome> {
    let output = Output { json: false };
    let started = Instant::now();
    let interrupt = Interrupt::listen()?;
    let (subject, name) = subject(args.scene.as_deref())?;
    let engine = Engine::open(&args.device)?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    let plan = if args.quick { Plan::QUICK } else { Plan::USUAL };
    let bar = output.bar(
        crate::lab::stress::outcome::Group::ALL.len() as u64,
        "stress",
    );
    let mut begun = 0;
    let found = stress::run(engine.gpu(), &subject, plan, &mut |group| {
        bar.set_position(begun);
        bar.set_message(group.title());
        begun += 1;
        match interrupt.is_requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    bar.finish_and_clear();
    engine.check()?;
    let Some(mut found) = found else {
        return Ok(Outcome::Interrupted);
    };
    // What was left out stands behind.
    found
        .facts
        .splice(0..0, facts(&engine, &subject, name, started));
    let page = write(&found, &args.out, args.json.as_deref())?;
    let mut lines = found
        .failed()
        .into_iter()
        .map(line)
        .collect::<Vec<String>>();
    lines.push(summary(&found));
    lines.push(format!("Look at {}", page.display()));
    output.result(lines.join("\n"), || unreachable!());
    verdict(&found)
}

/// What is tried, and what it is called.
fn subject(path: Option<&Path>) -> Result<(Subject, String)> {
    let Some(path) = path else {
        let subject = Subject::made();
        let name = format!("built in, {} splats", subject.splats.len());
        return Ok((subject, name));
    };
    let splats = read_scene(path)?;
    if splats.is_empty() {
        return Err(Error::file(path, "there are no splats to try"));
    }
    let cameras = orbit::orbit_of_splats(&splats, Some(VIEWS));
    let near = orbit::radius(&splats) * f64::from(TrainConfig::default().near_factor);
    let subject = Subject::of(&splats, &cameras, orbit::center(&splats), near);
    let name = format!("{}, {} splats", path.display(), splats.len());
    Ok((subject, name))
}

/// What a reader has to know of the figures.
fn facts(
    engine: &Engine,
    subject: &Subject,
    scene: String,
    started: Instant,
) -> Vec<(String, String)> {
    let caps = engine.gpu().caps();
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

/// The page, and the JSON if it is asked for; where the page is.
fn write(found: &Stress, folder: &Path, json: Option<&Path>) -> Result<PathBuf> {
    let path = folder.join("stress.html");
    let html = page::html(found)?;
    write_atomically(&path, |file| file.write_all(html.as_bytes()))?;
    if let Some(json) = json {
        let text = found
            .json()
            .map_err(|error| Error::Config(format!("the report: {error}")))?;
        write_atomically(json, |file| file.write_all((text + "\n").as_bytes()))?;
    }
    Ok(path)
}

/// A check in a line.
fn line(outcome: &crate::lab::stress::outcome::Outcome) -> String {
    format!(
        "FAILED: {}: {}: {} {}, bound {}",
        outcome.group.title(),
        outcome.name,
        page::number(outcome.measured),
        outcome.unit,
        page::number(outcome.bound)
    )
}

fn summary(found: &Stress) -> String {
    let (failed, count) = (found.failed().len(), found.outcomes.len());
    format!("{} of {count} checks keep their bounds", count - failed)
}

/// A check that fails is an error: the device, the driver or the engine does not do what it should.
fn verdict(found: &Stress) -> Result<Outcome> {
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
    use crate::lab::stress::outcome::{Group, Outcome as Check};

    #[test]
    fn a_failed_check_is_an_error_after_the_page_is_written() -> Result<()> {
        let found = |measured: f64| Stress {
            outcomes: vec![
                Check::at_most(Group::Device, "atomics", "", [0.0, 0.0], "wrong words"),
                Check::at_most(Group::Sizes, "1 × 1", "", [measured, 1e-4], "of 1"),
            ],
            ..Stress::default()
        };
        assert_eq!(verdict(&found(1e-5))?, Outcome::Done);
        for measured in [2e-4, f64::NAN] {
            let message = verdict(&found(measured))
                .err()
                .map(|error| error.to_string());
            let expected = "1 of 2 checks failed; the first: 1 × 1";
            assert_eq!(message.as_deref(), Some(expected));
        }
        assert!(verdict(&Stress::default()).is_err());
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
