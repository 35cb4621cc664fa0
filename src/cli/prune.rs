//! `ashfall prune`: removes splats that no training view needs, at a proven error.

mod figures;

use super::Outcome;
use super::args::{Compat, DataArgs, DeviceArgs};
use super::engine::{evaluator, near};
use super::interrupt::Interrupt;
use super::output::{Output, grouped};
use super::scene::{SceneArgs, fit_axes};
use super::{engine, parse};
use crate::gpu::Gpu;
use crate::io::splats::{readable, writable};
use crate::metrics::MeanScore;
use crate::scene::{Camera, Dataset, Primitive, Splats, Split};
use crate::simplify::{
    AutoRun, ContributionPass, PassOptions, Promise, difference, kept, measure, merge, prune, rates, reduce_harmonics,
    refit_config,
};
use crate::{Error, Result, io};
use clap::Args;
use figures::{Figures, MergeFigures};
use std::path::PathBuf;

/// Remove unneeded splats of a scene, at a proven error
///
/// Finds splats with weights (their shares of a pixel's colour) that sum to no more than ERROR at every pixel of every
/// training view, and removes them. No pixel of those views can then change by more than ERROR times the range of the
/// colours that it is mixed of. All pixels are measured; the exit code is 1 if one breaks the bound. Splats that no
/// training view shows go, too.
///
/// --merge first merges neighbours in pairs, each pair into the splat closest to both, without training. No bound of
/// that is proven. The change of the training views' pictures by merging is measured and printed: its maximum, its root
/// mean square, and the PSNR against the original scene. The proof, its bound and the change measured beside it refer
/// to the later removal, against the merged scene.
///
/// --sh-error drops SH degrees with little effect on a splat's colour. Files keep the usual layout, with zeros in their
/// place, up to the highest degree of any splat.
///
/// --refit trains the remaining splats for a few iterations, without adding or removing any; the result is scored on
/// the test views; the bound does not cover it.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct PruneArgs {
    #[arg(value_name = "SCENE", help = format!("The scene, {}, of this program or another", readable()))]
    scene: PathBuf,
    /// The data set, as for `ashfall train`
    #[arg(value_name = "DATA")]
    data: PathBuf,
    /// Largest sum of weights that a pixel may lose: a fraction or a number above 0, at most 1
    #[arg(long, value_name = "ERROR", default_value = "1/512", value_parser = parse::error)]
    error: f64,
    /// Merge neighbours first, cheapest pairs first, until SHARE of the splats is gone: a fraction or a number above 0,
    /// below 1 [without SHARE: 0.5, about one merge for each that is left; errors of more add up]
    #[arg(long, value_name = "SHARE", num_args = 0..=1, default_missing_value = "0.5", value_parser = parse::share)]
    merge: Option<f64>,
    /// Drop the highest SH degrees of a splat if no colour channel then changes by more than this in any direction
    /// [default: only zeros]
    #[arg(long, value_name = "ERROR", value_parser = parse::error)]
    sh_error: Option<f64>,
    #[arg(long, value_name = "FILE", help = format!(
        "Output file, {} only; without it nothing is written",
        writable()
    ))]
    out: Option<PathBuf>,
    /// Train the remaining splats for N iterations
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    refit: Option<u32>,
    /// Colour behind the splats: black, white or R,G,B (0 to 1)
    #[arg(long, value_name = "COLOR", default_value = "black", value_parser = parse::color)]
    background: [f32; 3],
    /// Rasterization rules: engine, this program's, or original, those of the 3DGS code
    #[arg(long, value_name = "RULES", default_value = "engine")]
    compat: Compat,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall prune run/scene.ply photos/                          what would go?
  ashfall prune run/scene.ply photos/ --error 1/64 --out less.ply
  ashfall prune theirs.ply photos/ --error 1/16 --refit 500 --out less.ply
  ashfall prune theirs.ply photos/ --merge 0.5 --refit 500 --out half.ply";

pub(super) fn run(args: &PruneArgs) -> Result<Outcome> {
    if args.refit.is_some() && args.compat == Compat::Original {
        let text = "--refit trains by this engine's rules: it cannot go with --compat original";
        return Err(Error::Config(text.into()));
    }
    args.out.as_deref().map_or(Ok(()), io::splats::check_name)?;
    let scene = args.scene_options.read(&args.scene)?;
    if scene.splats.primitive == Primitive::Surfel && args.merge.is_some() {
        let what = "holds surfels, two of which are not flat together: leave out --merge";
        return Err(Error::file(&args.scene, what));
    }
    let mut dataset = args.options.open(&args.data, true)?;
    dataset.set_origin(scene.splats.origin);
    let train = dataset.split(Split::Train);
    if train.is_empty() {
        return Err(Error::file(&args.data, "holds no training view"));
    }
    let output = Output { json: args.json };
    let gpu = engine::open(&args.device)?;
    let splats = fit_axes(&args.scene, scene, &gpu, &dataset, args.background)?;
    let work = PruneRun {
        args,
        gpu: &gpu,
        output,
        dataset: &dataset,
        cameras: train.iter().map(|&i| dataset.views[i].camera).collect(),
        interrupt: Interrupt::listen()?,
    };
    let found = work.run(&splats)?;
    engine::check(&gpu)?;
    let Some(figures) = found else {
        eprintln!("interrupted; nothing was written");
        return Ok(Outcome::Interrupted);
    };
    if figures.change.broken > 0 {
        return Err(Error::Mismatch {
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
    output.result(figures.text(args, &splats), || figures.json(args, &splats));
    Ok(Outcome::Done)
}

/// Inputs of a run.
struct PruneRun<'a> {
    args: &'a PruneArgs,
    gpu: &'a Gpu,
    output: Output,
    dataset: &'a Dataset,
    cameras: Vec<Camera>,
    interrupt: Interrupt,
}

impl PruneRun<'_> {
    /// Prunes, measures and scores; `None` if interrupted.
    fn run(&self, splats: &Splats) -> Result<Option<Figures>> {
        let output = self.output;
        let mut go_on = || !self.interrupt.is_requested();
        let error = self.args.error;
        let views = self.cameras.len();
        output.remark(format_args!(
            "{} · {} splats · {views} training views",
            self.gpu.caps().name,
            grouped(splats.len())
        ));
        let merging = self.args.merge.map(|share| self.merge(splats, share)).transpose()?;
        if let Some(None) = merging {
            return Ok(None);
        }
        let merging = merging.flatten();
        // Scene that the proof below refers to.
        let scene = merging.as_ref().map_or(splats, |m| &m.merged.splats);
        let mut weigher = self.weigher(scene)?;
        let Some(pruned) = prune(&mut weigher, &self.cameras, error, &mut go_on)? else {
            return Ok(None);
        };
        let left = kept(scene, &pruned.removed);
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
            // Dropped coefficients are trained with the others, so they are dropped again.
            reduced = reduce_harmonics(&fitted, promise.color);
            test.push(self.score(&reduced.splats)?);
        }
        if !go_on() {
            return Ok(None);
        }
        Ok(Some(Figures {
            views,
            merging,
            pruned,
            reduced,
            change,
            test,
        }))
    }

    /// The merged scene and the change of its pictures; `None` if interrupted.
    fn merge(&self, splats: &Splats, share: f64) -> Result<Option<MergeFigures>> {
        let mut go_on = || !self.interrupt.is_requested();
        let wanted = share * splats.len() as f64;
        let bar = self.output.bar(wanted as u64, "merging");
        let rates = rates(splats, &self.cameras, near(self.dataset));
        let merged = merge(splats, &rates, share, &mut |gone| {
            bar.set_position(gone as u64);
            go_on()
        });
        bar.finish_and_clear();
        let Some(merged) = merged else {
            return Ok(None);
        };
        let [mut before, mut after] = [self.weigher(splats)?, self.weigher(&merged.splats)?];
        let moved = difference(&mut before, &mut after, &self.cameras, &mut go_on)?;
        drop((before, after));
        let Some(moved) = moved else {
            return Ok(None);
        };
        let test = self.score(&merged.splats)?;
        Ok(Some(MergeFigures { merged, moved, test }))
    }

    fn weigher(&self, splats: &Splats) -> Result<ContributionPass> {
        let pass_options = PassOptions {
            near: near(self.dataset) as f32,
            background: self.args.background,
            compatibility: self.args.compat.into(),
        };
        ContributionPass::new(self.gpu, splats, pass_options)
    }

    /// Mean score over the test views.
    fn score(&self, splats: &Splats) -> Result<MeanScore> {
        let views = self.dataset.split(Split::Test);
        let mut evaluator =
            evaluator(self.gpu, self.dataset, &views, self.args.background).drawing_as(self.args.compat.into());
        Ok(MeanScore::of(&evaluator.scores(splats)?))
    }

    fn refit(&self, splats: &Splats, iterations: u32) -> Result<Option<Splats>> {
        if splats.is_empty() {
            return Ok(Some(splats.clone()));
        }
        let config = refit_config(splats, iterations, self.args.background);
        let mut run = AutoRun::from_splats(self.gpu, self.dataset, config, splats)?;
        while run.iteration() < iterations {
            if self.interrupt.is_requested() {
                return Ok(None);
            }
            run.step()?;
        }
        run.finish()?;
        Ok(Some(run.splats()?))
    }
}
