//! `ashfall prune`: takes out of a scene what no training view misses, and proves it.

use super::Outcome;
use super::args::{Compat, DataArgs, DeviceArgs, parse_color};
use super::engine::Engine;
use super::eval::{near, read_scene};
use super::interrupt::Interrupt;
use super::output::{Output, bytes, grouped, score_text};
use super::train::Steps;
use crate::parsimony::{
    Change, Lens, Promise, Pruned, Reduced, Weigher, kept, measure, prune, reduce_harmonics,
    refit_config,
};
use crate::report::{MeanScore, Target};
use crate::scene::{Camera, Dataset, Splats, Split, sh_coefficient_count};
use crate::{Error, Result, io};
use clap::Args;
use serde_json::json;
use std::path::PathBuf;

/// Remove what a scene does not need, at a proven error
///
/// Finds splats whose weights, the shares of a pixel's colour that they make up, sum to no more than ERROR at every
/// pixel of every training view, and takes them out. No pixel of those views can then change by more than ERROR
/// times the range of the colours that it is mixed of. That is measured on all of them, and the exit code is 1 if
/// one pixel breaks it. Splats that no training view shows go, too.
///
/// --sh-error takes from each splat the harmonics that its colour hardly needs. Files keep the usual layout, with zeros
/// in their place, up to the highest degree that any splat has.
///
/// --refit trains what is left for a few iterations, without adding or removing any; what it gives is judged by
/// the test views, not by the bound.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct PruneArgs {
    /// The scene: a .ply (or .splat) file, of this program or another
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// The data set, as for `ashfall train`
    #[arg(value_name = "DATA")]
    data: PathBuf,
    /// Largest sum of weights that a pixel may lose: a fraction or a number above 0, at most 1
    #[arg(long, value_name = "ERROR", default_value = "1/512", value_parser = parse_error)]
    error: f64,
    /// Drop the highest degrees of splats' harmonics where no channel of their colours is then off by more than this in
    /// any direction [default: only what is zero]
    #[arg(long, value_name = "ERROR", value_parser = parse_error)]
    sh_error: Option<f64>,
    /// The .ply file for what is left; without it nothing is written
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Train what is left for N iterations
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    refit: Option<u32>,
    /// Colour behind the splats: black, white or R,G,B (0 to 1)
    #[arg(long, value_name = "COLOR", default_value = "black", value_parser = parse_color)]
    background: [f32; 3],
    /// Whose rules pictures are drawn by: engine, this program's, or original, those of the 3DGS code
    #[arg(long, value_name = "RULES", default_value = "engine")]
    compat: Compat,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall prune run/scene.ply photos/                          what would go?
  ashfall prune run/scene.ply photos/ --error 1/64 --out less.ply
  ashfall prune theirs.ply photos/ --error 1/16 --refit 500 --out less.ply";

pub(super) fn run(args: &PruneArgs) -> Result<Outcome> {
    if args.refit.is_some() && args.compat == Compat::Original {
        let text = "--refit trains by this engine's rules: it cannot go with --compat original";
        return Err(Error::Config(text.into()));
    }
    args.out.as_deref().map_or(Ok(()), io::splats::check_name)?;
    let splats = read_scene(&args.scene)?;
    let mut dataset = args.options.open(&args.data, true)?;
    dataset.set_origin(splats.origin);
    let train = dataset.split(Split::Train);
    if train.is_empty() {
        return Err(Error::file(&args.data, "holds no training view"));
    }
    let engine = Engine::open(&args.device)?;
    let work = Work {
        args,
        engine: &engine,
        dataset: &dataset,
        cameras: train.iter().map(|&i| dataset.views[i].camera).collect(),
        interrupt: Interrupt::listen()?,
    };
    let found = work.run(&splats)?;
    engine.check()?;
    let Some(figures) = found else {
        eprintln!("interrupted; nothing was written");
        return Ok(Outcome::Interrupted);
    };
    if figures.change.broken > 0 {
        return Err(Error::Wrong {
            kernel: "prune".into(),
            what: format!(
                "{} channels of pixels moved farther than their bound, the farthest by {:.6}; nothing was written",
                figures.change.broken, figures.change.most
            ),
        });
    }
    if let Some(out) = &args.out {
        io::splats::write(out, &figures.reduced.splats)?;
    }
    let output = Output { json: args.json };
    output.result(figures.text(args, &splats), || figures.json(args, &splats));
    Ok(Outcome::Done)
}

/// A number from 0 to 1, or a fraction of two numbers.
fn parse_error(text: &str) -> std::result::Result<f64, String> {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let value = match text.split_once('/') {
        Some((above, below)) => number(above).zip(number(below)).map(|(a, b)| a / b),
        None => number(text),
    };
    value
        .filter(|value| *value > 0.0 && *value <= 1.0)
        .ok_or_else(|| "a number above 0 and at most 1 is expected, such as 1/512".into())
}

/// Bytes of a scene as a .ply: position, normal, harmonics, opacity, scale and rotation in 32 bits each.
fn ply_bytes(splats: &Splats) -> u64 {
    let floats = 14 + 3 * sh_coefficient_count(splats.sh_degree);
    4 * floats as u64 * splats.len() as u64
}

/// What a run is made of.
struct Work<'a> {
    args: &'a PruneArgs,
    engine: &'a Engine,
    dataset: &'a Dataset,
    cameras: Vec<Camera>,
    interrupt: Interrupt,
}

impl Work<'_> {
    /// What is left, and what is to be said of it; `None` if interrupted.
    fn run(&self, splats: &Splats) -> Result<Option<Figures>> {
        let output = Output {
            json: self.args.json,
        };
        let mut go_on = || !self.interrupt.is_requested();
        let error = self.args.error;
        let mut weigher = self.weigher(splats)?;
        let views = self.cameras.len();
        output.remark(format_args!(
            "{} · {} splats · {views} training views",
            self.engine.name(),
            grouped(splats.len())
        ));
        let Some(pruned) = prune(&mut weigher, &self.cameras, error, &mut go_on)? else {
            return Ok(None);
        };
        let left = kept(splats, &pruned.removed);
        let promise = Promise {
            weight: error,
            color: self.args.sh_error.unwrap_or(0.0),
        };
        let mut reduced = reduce_harmonics(&left, promise.color);
        let mut after = self.weigher(&reduced.splats)?;
        let change = measure(&mut weigher, &mut after, &self.cameras, promise, &mut go_on)?;
        let Some(change) = change else {
            return Ok(None);
        };
        drop((weigher, after));
        let mut test = vec![self.score(splats)?, self.score(&reduced.splats)?];
        if let Some(iterations) = self.args.refit {
            let Some(fitted) = self.refit(&reduced.splats, iterations)? else {
                return Ok(None);
            };
            // Coefficients that were dropped have been trained with the others.
            reduced = reduce_harmonics(&fitted, promise.color);
            test.push(self.score(&reduced.splats)?);
        }
        if !go_on() {
            return Ok(None);
        }
        let figures = Figures {
            views,
            pruned,
            reduced,
            change,
            test,
        };
        Ok(Some(figures))
    }

    fn weigher(&self, splats: &Splats) -> Result<Weigher> {
        let lens = Lens {
            near: near(self.dataset) as f32,
            background: self.args.background,
            compatibility: self.args.compat.into(),
        };
        Weigher::new(self.engine.gpu(), splats, lens)
    }

    /// Means over the test views.
    fn score(&self, splats: &Splats) -> Result<MeanScore> {
        let background = self.args.background;
        let compatibility = self.args.compat.into();
        let near = near(self.dataset);
        let mut artist = self
            .engine
            .artist_like(splats, near, false, compatibility)?;
        let mut scores = Vec::new();
        for index in self.dataset.split(Split::Test) {
            let view = &self.dataset.views[index];
            let photo = io::photo::load(view)?;
            let target = Target::new(&photo, self.dataset.alpha, background);
            let picture = artist.draw(&view.camera, background)?;
            scores.push(target.score(&view.name, &picture.rgb));
        }
        Ok(MeanScore::of(&scores))
    }

    fn refit(&self, splats: &Splats, iterations: u32) -> Result<Option<Splats>> {
        if splats.is_empty() {
            return Ok(Some(splats.clone()));
        }
        let config = refit_config(splats, iterations, self.args.background);
        let mut training = self.engine.refit(self.dataset, config, splats)?;
        while training.iteration() < iterations {
            if self.interrupt.is_requested() {
                return Ok(None);
            }
            training.step()?;
        }
        training.finish()?;
        Ok(Some(training.splats()?))
    }
}

/// What there is to say.
struct Figures {
    views: usize,
    pruned: Pruned,
    /// What is left.
    reduced: Reduced,
    change: Change,
    /// Of the scene as it was, of what is left, and of that after a re-fit.
    test: Vec<MeanScore>,
}

impl Figures {
    fn text(&self, args: &PruneArgs, before: &Splats) -> String {
        let (pruned, change) = (&self.pruned, &self.change);
        let after = &self.reduced.splats;
        let share = 100.0 * pruned.count as f64 / before.len().max(1) as f64;
        let mut lines = vec![
            format!(
                "{} splats, {} → {} splats, {}: {} went ({share:.1} %), {} of them seen by no training view",
                grouped(before.len()),
                bytes(ply_bytes(before)),
                grouped(after.len()),
                bytes(ply_bytes(after)),
                grouped(pruned.count),
                grouped(pruned.unseen),
            ),
            format!(
                "{} weigh no more than {:.6} wherever they are seen; {} rounds over {} training views",
                grouped(pruned.light),
                args.error,
                pruned.rounds,
                self.views,
            ),
            format!(
                "largest change of {} pixels: {:.6}, where {:.6} was the bound; nearest to a bound: {:.3} of it",
                grouped(change.pixels),
                change.most,
                change.bound_there,
                change.nearest,
            ),
        ];
        let [zero, one, two, three] = self.reduced.count_from_degree.map(grouped);
        let stored = before.sh_stride() * after.len();
        lines.push(format!(
            "degrees 0 to 3: {zero} · {one} · {two} · {three} splats, {:.1} % of their harmonics",
            100.0 * self.reduced.floats as f64 / stored.max(1) as f64
        ));
        let names = [
            "test views before",
            "test views after ",
            "after the re-fit ",
        ];
        let scores = names.iter().zip(&self.test);
        lines.extend(scores.map(|(name, score)| format!("{name}: {}", score_text(score))));
        lines.push(match &args.out {
            Some(out) => format!("scene: {}", out.display()),
            None => "nothing was written: no --out".into(),
        });
        lines.join("\n")
    }

    fn json(&self, args: &PruneArgs, before: &Splats) -> serde_json::Value {
        let (change, after) = (&self.change, &self.reduced.splats);
        json!({
            "scene": args.scene,
            "out": args.out,
            "error": args.error,
            "train_views": self.views,
            "splats_before": before.len(),
            "splats_after": after.len(),
            "ply_bytes_before": ply_bytes(before),
            "ply_bytes_after": ply_bytes(after),
            "removed": self.pruned.count,
            "unseen": self.pruned.unseen,
            "light": self.pruned.light,
            "rounds": self.pruned.rounds,
            "sh_error": args.sh_error,
            "splats_by_degree": self.reduced.count_from_degree,
            "sh_floats": self.reduced.floats,
            "change": {
                "pixels": change.pixels,
                "most": change.most,
                "bound_there": change.bound_there,
                "nearest": change.nearest,
                "broken": change.broken,
                "color_range": change.range,
            },
            "refit_iterations": args.refit,
            "test_before": self.test.first(),
            "test_after": self.test.get(1),
            "test_after_refit": self.test.get(2),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_fractions_or_numbers() {
        assert_eq!(parse_error("1/512"), Ok(1.0 / 512.0));
        assert_eq!(parse_error("0.25"), Ok(0.25));
        assert_eq!(parse_error("1"), Ok(1.0));
        for bad in ["", "0", "-1", "2", "1/0", "0/3", "nan", "1/2/3", "a/b"] {
            assert!(parse_error(bad).is_err(), "{bad}");
        }
    }
}
