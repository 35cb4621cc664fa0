//! Commands of the binary: parse, call the library, report.
//!
//! Results go to standard output, progress and diagnostics to standard error. Exit codes: 0 done, 1 an error (one line,
//! `error: …`), 2 a command line that cannot be parsed, 130 interrupted.
//!
//! **Invariant:** this is the only place that reads an environment variable (`ASHFALL_DEVICE`).

mod args;
mod bench;
mod cameras;
mod capture;
mod chart;
mod configure;
mod demo;
mod engine;
mod eval;
mod export;
mod info;
mod interrupt;
mod mesh;
mod needs;
mod output;
mod parse;
mod predict;
mod prune;
mod render;
mod scene;
mod stress;
mod train;

use crate::Result;
use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Fits 3D Gaussian splats to photographs and renders them, on any Vulkan 1.3 device.
#[derive(Debug, Parser)]
#[command(name = "ashfall", version, after_help = EXAMPLES, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  ashfall demo                                    a small scene from scratch, in minutes
  ashfall capture photographs/ --out photos/      poses of photographs, by COLMAP
  ashfall train photos/ --out run/                train; run/scene.ply is the result
  ashfall eval run/scene.ply photos/              how good is it on held-out photographs?
  ashfall render run/scene.ply --cameras photos/ --orbit 60 --out frames/
  ashfall mesh run/scene.ply photos/ --out mesh.glb
  ashfall prune run/scene.ply photos/             what can go at a proven error?
  ashfall export run/scene.ply photos/ --out scene.spz --loss 0.1
  ashfall chart                                   what does speed cost in accuracy?
  ashfall needs                                   how many splats do scenes need?
  ashfall stress                                  does this device do what it should?
  ashfall info                                    which devices are there?
  ashfall info photos/ --predict                  how much memory will training take?

`ashfall COMMAND --help` explains each command. The device is chosen with --device or the
environment variable ASHFALL_DEVICE.";

#[derive(Debug, Subcommand)]
enum Command {
    Capture(capture::CaptureArgs),
    Train(train::TrainArgs),
    Render(render::RenderArgs),
    Eval(eval::EvalArgs),
    Mesh(mesh::MeshArgs),
    Prune(prune::PruneArgs),
    Export(export::ExportArgs),
    Info(info::InfoArgs),
    Demo(demo::DemoArgs),
    Chart(chart::ChartArgs),
    Needs(needs::NeedsArgs),
    Stress(stress::StressArgs),
    Bench(bench::BenchArgs),
}

/// End of a command without an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Done,
    Interrupted,
}

/// Conventional exit code of a program that SIGINT ended: 128 + 2.
const EXIT_INTERRUPTED: u8 = 130;

/// The binary's `main`.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(cli.command) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Interrupted) => ExitCode::from(EXIT_INTERRUPTED),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<Outcome> {
    match command {
        Command::Capture(args) => capture::run(&args),
        Command::Train(args) => train::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Mesh(args) => mesh::run(&args),
        Command::Prune(args) => prune::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Chart(args) => chart::run(&args),
        Command::Needs(args) => needs::run(&args),
        Command::Stress(args) => stress::run(&args),
        Command::Bench(args) => bench::run(&args),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed_and_every_option_is_explained() {
        let mut command = Cli::command();
        command.clone().debug_assert();
        command.build();
        for sub in command.get_subcommands() {
            assert!(sub.get_about().is_some(), "{}", sub.get_name());
            for argument in sub.get_arguments() {
                assert!(
                    argument.get_help().is_some(),
                    "{} {}",
                    sub.get_name(),
                    argument.get_id()
                );
            }
        }
    }
}
