//! `ashfall eval`: PSNR and SSIM of renderings against the photographs.

mod mesh;
mod poses;
mod surface;

use super::Outcome;
use super::args::{DataArgs, DeviceArgs, SplitArg};
use super::engine::evaluator;
use super::output::{Output, figure, file_stem, score_text};
use super::scene::{SceneArgs, fit_axes};
use super::{engine, parse};
use crate::export::Pictures;
use crate::gpu::Gpu;
use crate::io::splats::readable;
use crate::lab::report::comparison;
use crate::metrics::{CorrectedScore, CorrectedScores, MeanScore, ViewScore};
use crate::render::ViewEvaluation;
use crate::scene::{Dataset, Splats};
use crate::{Error, Result};
use clap::Args;
use clap::builder::ArgPredicate;
use poses::CameraMoves;
use serde::Serialize;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Score a scene against the photographs of a data set
///
/// PSNR and SSIM (11 × 11 Gaussian window, σ 1.5, all three channels, borders padded with zeros) of float
/// renderings, and of both pictures rounded to 8 bits.
///
/// Beside these raw figures, those after a correction of colours tell exposure from shape. cc: each rendering under the
/// affine map, 12 numbers, that brings it nearest to its photograph over the pixels that are scored, then clipped.
/// half: each half of the picture under the map fitted to the other half, so that no pixel is used both ways.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct EvalArgs {
    #[arg(value_name = "SCENE", help = format!("The scene, {}", readable()), required = false)]
    #[arg(
        required_unless_present = "mesh",
        default_value_if("mesh", ArgPredicate::IsPresent, "-")
    )]
    scene: PathBuf,
    /// The data set, as for `ashfall train`
    #[arg(value_name = "DATA", required = false)]
    #[arg(
        required_unless_present = "mesh",
        default_value_if("mesh", ArgPredicate::IsPresent, "-")
    )]
    data: PathBuf,
    /// Score against pictures of this scene, the original of an exported one, instead of the photographs
    #[arg(long, value_name = "FILE", conflicts_with = "pictures")]
    reference: Option<PathBuf>,
    /// Reconstruction of the same photographs in the scene's coordinates, as refined/ of a run: training views have its
    /// poses, and the others are moved by the similarity between both (sim3)
    #[arg(long, value_name = "DATA", conflicts_with = "reference")]
    poses: Option<PathBuf>,
    /// Fit the camera of each view to its photograph before it is scored (aligned): 6 numbers a view, no splat. Tells
    /// errors of test poses from those of the scene
    #[arg(long, conflicts_with_all = ["reference", "depths", "mesh"])]
    align: bool,
    /// Score depths and normals instead of colours: against those of DIR/VIEW.exr (channels Z, N.X, N.Y and N.Z; depth
    /// along the view's axis, normals in the world, as `ashfall demo --truth` and `render --format exr` write them)
    #[arg(long, value_name = "DIR", conflicts_with_all = ["reference", "pictures"])]
    depths: Option<PathBuf>,
    /// Views to score
    #[arg(long, value_name = "SPLIT", default_value = "test")]
    split: SplitArg,
    /// Colour behind the splats: black, white or R,G,B (0 to 1)
    #[arg(long, value_name = "COLOR", default_value = "black", value_parser = parse::color)]
    background: [f32; 3],
    /// Write photograph | rendering | difference × 4 of each view to DIR
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    mesh: mesh::MeshScoreArgs,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall eval run/scene.ply photos/
  ashfall eval run/scene.ply photos/ --split all --json > scores.json
  ashfall eval run/scene.ply photos/ --poses run/refined --align
  ashfall eval run/scene.ply photos/ --pictures comparison/
  ashfall eval scene.spz photos/ --reference run/scene.ply
  ashfall eval scene.ply out/demo/data --depths out/demo/data/truth
  ashfall eval --mesh mesh.ply --truth true.obj --cameras photos/";

pub(super) fn run(args: &EvalArgs) -> Result<Outcome> {
    let output = Output { json: args.json };
    if let Some(path) = &args.mesh.mesh {
        return mesh::run(&args.mesh, path, &args.options, output);
    }
    let scene = args.scene_options.read(&args.scene)?;
    // As in training: views without a photograph are left out before the split.
    let needs_photos = args.reference.is_none() && args.depths.is_none();
    let mut dataset = args.options.open(&args.data, needs_photos)?;
    let mut moves = CameraMoves::to_poses(args, &mut dataset)?;
    dataset.set_origin(scene.splats.origin);
    let views = dataset.split(args.split.into());
    if views.is_empty() {
        return Err(Error::file(&args.data, "no view belongs to that split"));
    }
    if let Some(dir) = &args.pictures {
        std::fs::create_dir_all(dir).map_err(Error::io(dir))?;
    }
    let gpu = engine::open(&args.device)?;
    let splats = fit_axes(&args.scene, scene, &gpu, &dataset, args.background)?;
    if let Some(reference) = &args.reference {
        return against(args, reference, &splats, &gpu, &dataset, &views);
    }
    if let Some(truth) = &args.depths {
        return surface::run(args, truth, (&splats, &gpu), (&dataset, &views));
    }
    moves.align(args, &splats, &gpu, (&mut dataset, &views))?;
    let mut evaluator = evaluator(&gpu, &dataset, &views, args.background);
    let bar = output.bar(views.len() as u64, "views");
    let scores = evaluator.map(&splats, |evaluated| {
        bar.inc(1);
        if let Some(dir) = &args.pictures {
            write_comparison(dir, evaluated)?;
        }
        Ok(ViewFigures {
            raw: evaluated.score(),
            corrected: evaluated.corrected(),
        })
    })?;
    bar.finish_and_clear();
    engine::check(&gpu)?;
    let raw: Vec<ViewScore> = scores.iter().map(|view| view.raw.clone()).collect();
    let corrected: Vec<CorrectedScores> = scores.iter().map(|view| view.corrected).collect();
    let (mean, mean_corrected) = (MeanScore::of(&raw), CorrectedScores::mean(&corrected));
    let text = table(&scores, &mean, &mean_corrected) + &moves.text();
    let [poses, similarity, alignment] = moves.values();
    output.result(text, || {
        json!({
            "scene": args.scene,
            "device": gpu.caps().name,
            "splat_count": splats.len(),
            "poses": poses,
            "similarity": similarity,
            "alignment": alignment,
            "mean": mean,
            "mean_corrected": mean_corrected,
            "views": scores,
        })
    });
    Ok(Outcome::Done)
}

/// Scores a scene against the pictures of another.
fn against(
    args: &EvalArgs,
    reference: &Path,
    splats: &Splats,
    gpu: &Gpu,
    dataset: &Dataset,
    views: &[usize],
) -> Result<Outcome> {
    // `--axes` is for the scene; the original states its own.
    let original = SceneArgs::default().read(reference)?.splats;
    let cameras = views.iter().map(|&i| dataset.views[i].camera).collect();
    let options = engine::view_options(dataset, args.background, original.filter);
    let error = Pictures::new(gpu, &original, cameras, options, None)?.error(splats)?;
    engine::check(gpu)?;
    let (psnr_db, ssim, largest) = (error.psnr_db(), error.ssim, error.largest);
    let text = format!(
        "{} views: {psnr_db:.2} dB, SSIM {ssim:.4}, largest difference {largest:.3}",
        views.len()
    );
    Output { json: args.json }.result(text, || {
        json!({
            "scene": args.scene,
            "reference": reference,
            "views": views.len(),
            "psnr_db": psnr_db,
            "ssim": ssim,
            "largest": largest,
        })
    });
    Ok(Outcome::Done)
}

/// Scores of a view.
#[derive(Serialize)]
struct ViewFigures {
    #[serde(flatten)]
    raw: ViewScore,
    #[serde(flatten)]
    corrected: CorrectedScores,
}

fn table(scores: &[ViewFigures], mean: &MeanScore, corrected: &CorrectedScores) -> String {
    let names = scores.iter().map(|s| s.raw.name.chars().count());
    let width = names.max().unwrap_or(0);
    let mut text = format!(
        "{:width$} {:>8} {:>7} {:>13} {:>10} {:>8} {:>7} {:>15}\n",
        "view", "PSNR dB", "SSIM", "8-bit PSNR dB", "8-bit SSIM", "cc dB", "cc SSIM", "half dB"
    );
    for ViewFigures { raw, corrected } in scores {
        let cc = corrected.cc_affine12_direct;
        text += &format!(
            "{:width$} {:>8} {:>7} {:>13} {:>10} {:>8} {:>7} {:>15}\n",
            raw.name,
            figure(raw.psnr_db, 3),
            figure(raw.ssim, 4),
            figure(raw.psnr_db_8bit, 3),
            figure(raw.ssim_8bit, 4),
            figure(cc.psnr_db, 3),
            figure(cc.ssim, 4),
            halves(corrected),
        );
    }
    let CorrectedScore { psnr_db, ssim } = corrected.cc_affine12_direct;
    text += &format!("mean: {}\n", score_text(mean));
    text + &format!(
        "corrected by 12 numbers a view (cc): {} dB, SSIM {}; left | right half by the other's: {} dB",
        figure(psnr_db, 2),
        figure(ssim, 4),
        halves(corrected),
    )
}

/// Decibels of the left and the right half.
fn halves(scores: &CorrectedScores) -> String {
    let of = &scores.half_affine12_direct;
    format!("{} | {}", figure(of.left.psnr_db, 2), figure(of.right.psnr_db, 2))
}

/// Writes photograph | rendering | difference of a view to a folder, under the view's name.
pub(super) fn write_comparison(dir: &Path, evaluated: ViewEvaluation<'_>) -> Result<()> {
    let path = dir.join(file_stem(&evaluated.view.name) + ".png");
    let target = evaluated.target;
    let size = [target.width, target.height];
    comparison(&path, size, &target.rgb, &evaluated.rendered.rgb)
}
