//! `ashfall needs`: splat counts of scenes by recipe, on one page.

mod session;

use super::Outcome;
use super::args::{DataArgs, DeviceArgs};
use super::engine;
use super::interrupt::Interrupt;
use super::output::{Output, write_text};
use super::parse;
use crate::lab::survey::Recipe;
use crate::lab::synth::Kind;
use crate::train::TrainConfig;
use crate::{Error, Result, io};
use clap::Args;
use std::path::PathBuf;

use session::SurveySession;

/// Compare splats, harmonics, quality and time of scenes by recipe
///
/// Trains every scene, the built-in ones and the photographs of every DATA, by the fixed recipe, to no more splats than
/// it needs (`train --parsimony`), likewise with all harmonics, and by MCMC with as many splats as that ended with, for
/// the same number of steps and from several seeds. Writes needs.csv, a line for every run, as runs end, and needs.html
/// with a table of all recipes and a figure for every scene.
///
/// Ctrl-C stops after the current step; the same command goes on with the runs that are missing in needs.csv.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct NeedsArgs {
    /// Data sets, as for `ashfall train`; each is called by its folder's name, or by NAME of NAME=DATA
    #[arg(value_name = "DATA")]
    data: Vec<PathBuf>,
    /// Folder for the page and its numbers, made if it is missing
    #[arg(long, value_name = "DIR", default_value = "out/needs")]
    out: PathBuf,
    /// Runs of each recipe, of seeds 0 and up
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// Steps of every run
    #[arg(long, value_name = "N", default_value_t = 2_000, value_parser = clap::value_parser!(u32).range(20..))]
    iterations: u32,
    /// Width of the built-in scenes' photographs in pixels
    #[arg(long, value_name = "W", default_value_t = 192, value_parser = clap::value_parser!(u32).range(16..=4096))]
    width: u32,
    /// Built-in scenes: plane, sphere, solids, demo, intricate, foliage, facade, knot, cage, or none [default: the
    /// first seven]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = parse_scene)]
    scenes: Option<Vec<Option<Kind>>>,
    /// Recipes to run: fixed, fixed-rates, parsimony, mcmc, mcmc-rates, parsimony-all-sh [default: all but fixed-rates
    /// and mcmc-rates]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = parse_recipe)]
    recipes: Option<Vec<Recipe>>,
    /// Constants of parsimony, each also trained with at half and at twice its value, or at VALUE of NAME=VALUE:
    /// auto.growth_share, drop_rate=0.1 and others
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    vary: Vec<String>,
    /// Run these recipes again even if DIR has their runs
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = parse_recipe)]
    again: Vec<Recipe>,
    /// Decibels that held-out training views may lose by fewer splats, as for `ashfall train --parsimony`
    #[arg(long, value_name = "LOSS", default_value_t = TrainConfig::default().auto.loss_db, value_parser = parse::loss)]
    loss: f64,
    /// Write photograph, rendering and fourfold difference of test views, too, to a folder of each run in DIR/pictures
    #[arg(long)]
    pictures: bool,
    /// Begin anew even if DIR has runs with other settings
    #[arg(long)]
    overwrite: bool,
    /// File the numbers as FILE, too
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall needs                                     seven made scenes: hours on a software device
  ashfall needs --scenes plane,demo --seeds 1 --iterations 500
  ashfall needs photos/ --scenes foliage --vary auto.growth_share,auto.round_share
  ashfall needs photos/ fox=data/colmap --downscale 2 --scenes none --loss 0.05";

fn parse_scene(text: &str) -> std::result::Result<Option<Kind>, String> {
    let found = Kind::ALL.into_iter().find(|kind| kind.name() == text);
    let names = || Kind::ALL.map(Kind::name).join(", ");
    match (found, text) {
        (None, "none") => Ok(None),
        (None, _) => Err(format!("there are {}, and none", names())),
        (kind, _) => Ok(kind),
    }
}

fn parse_recipe(text: &str) -> std::result::Result<Recipe, String> {
    let found = Recipe::ALL.into_iter().find(|recipe| recipe.name() == text);
    found.ok_or_else(|| format!("there are {}", Recipe::ALL.map(Recipe::name).join(", ")))
}

pub(super) fn run(args: &NeedsArgs) -> Result<Outcome> {
    let output = Output { json: false };
    let gpu = engine::open(&args.device)?;
    let mut session = SurveySession::begin(args, &gpu, output)?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    io::atomic::remove_leftovers(&args.out);
    let outcome = session.run(&Interrupt::listen()?)?;
    engine::check(&gpu)?;
    session.write()?;
    if outcome == Outcome::Interrupted {
        output.result("interrupted; the same command goes on", || unreachable!());
        return Ok(outcome);
    }
    let page = args.out.join("needs.html");
    let text = format!("Look at {}", page.display());
    output.result(text, || unreachable!());
    if let Some(path) = &args.record {
        write_text(path, &session.csv()?)?;
        output.remark(format_args!("Filed as {}", path.display()));
    }
    Ok(outcome)
}
