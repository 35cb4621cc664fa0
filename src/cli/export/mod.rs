//! `ashfall export`: a scene in another format, in as few bytes as its picture needs.

mod curve;
mod views;

use super::args::{DataArgs, DeviceArgs};
use super::interrupt::Interrupt;
use super::output::{Output, grouped};
use super::scene::{SceneArgs, fit_axes};
use super::{Outcome, engine, parse};
use crate::export::{Budget, EncodedScene, ExportFormat, ExportSource, Ladder, PictureError, Setting};
use crate::io::splats::{holds_surfels, losses, readable};
use crate::scene::Splats;
use crate::{Error, Result};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use views::Views;

/// Write a scene in another format
///
/// With DATA, harmonics are rounded together, so that colours are right in the directions of the training cameras:
/// files of the same format and length that lose less. --loss and --bytes choose the settings of the format by
/// rendered views, up to eight of those trained on. Without DATA the views lie on a
/// sphere around the scene if a budget is given, and numbers are rounded one by one otherwise.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ExportArgs {
    #[arg(value_name = "SCENE", help = format!("The scene, {}", readable()))]
    scene: PathBuf,
    /// The data set, as for `ashfall train`; its cameras suffice
    #[arg(value_name = "DATA")]
    data: Option<PathBuf>,
    /// Output file
    #[arg(long, value_name = "FILE", required_unless_present = "curve")]
    out: Option<PathBuf>,
    /// Measure every format and setting: curve.html and curve.csv in DIR
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "format", "loss", "bytes"])]
    curve: Option<PathBuf>,
    /// Files of the same scene by other programs, also measured for --curve
    #[arg(long, value_name = "FILE", requires = "curve")]
    with: Vec<PathBuf>,
    #[arg(long, value_name = "FORMAT", help = format!(
        "Format, if not that of the name: {}",
        ExportFormat::names().collect::<Vec<_>>().join(", ")
    ), value_parser = target)]
    format: Option<ExportFormat>,
    /// Fewest bytes that lose no more than DB decibels against the photographs; without photographs, no more than a
    /// scene of 30 dB would lose
    #[arg(long, value_name = "DB", value_parser = parse::loss)]
    loss: Option<f64>,
    /// Least error within N bytes, e.g. 2M
    #[arg(long, value_name = "N", value_parser = parse::size, conflicts_with = "loss")]
    bytes: Option<u64>,
    /// Write surfels as 3D Gaussians, their third scale a hundredth of the smaller one
    #[arg(long, conflicts_with = "curve")]
    as_3d: bool,
    /// Colour behind the splats of the views: black, white or R,G,B (0 to 1)
    #[arg(long, value_name = "COLOR", default_value = "black", value_parser = parse::color)]
    background: [f32; 3],
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
  ashfall export run/scene.ply --out scene.spz
  ashfall export run/scene.ply photos/ --out scene.spz --loss 0.1
  ashfall export run/scene.ply photos/ --out scene.compressed.ply
  ashfall export theirs.sog --out scene.ply
  ashfall export surfels.ply --as-3d --out splats.ply
  ashfall export run/scene.ply photos/ --curve curve/ --with theirs.spz";

fn target(name: &str) -> std::result::Result<ExportFormat, String> {
    let names = || ExportFormat::names().collect::<Vec<_>>().join(", ");
    ExportFormat::parse(name).ok_or_else(|| format!("formats are {}", names()))
}

pub(super) fn run(args: &ExportArgs) -> Result<Outcome> {
    let output = Output { json: args.json };
    let wanted = match &args.out {
        Some(out) => Some((out.as_path(), args.format.map_or_else(|| ExportFormat::of(out), Ok)?)),
        None => None,
    };
    let mut loaded = args.scene_options.read(&args.scene)?;
    let mut omissions = Vec::new();
    if let Some((_, target)) = wanted {
        if args.as_3d {
            loaded.splats = loaded.splats.into_3d();
        }
        omissions = losses(target.end(), &loaded.splats);
        if !holds_surfels(target.end()) {
            loaded.splats = loaded.splats.into_3d();
        }
    }
    let budget = args.loss.map(Budget::Loss).or(args.bytes.map(Budget::Bytes));
    if let (Some((out, target)), None, None) = (wanted, &args.data, budget) {
        let source = ExportSource::new(loaded.splats);
        let (count, setting) = (source.splats().len(), plain(target, source.splats()));
        let spinner = output.spinner("encoding");
        let encoded = source.into_encoded(target, setting)?;
        spinner.finish_and_clear();
        return finish(args, (out, target), omissions, count, &encoded, None);
    }
    let mut dataset = match &args.data {
        Some(path) => Some(args.options.open(path, false)?),
        None => None,
    };
    if let Some(dataset) = &mut dataset {
        dataset.set_origin(loaded.splats.origin);
    }
    let gpu = engine::open(&args.device)?;
    let splats = match &dataset {
        Some(dataset) => fit_axes(&args.scene, loaded, &gpu, dataset, args.background)?,
        None => loaded.splats,
    };
    let interrupt = Interrupt::listen()?;
    let views = Views::new(args, dataset.as_ref(), &splats)?;
    let Some(influence) = views.influence(&gpu, &splats, &interrupt)? else {
        eprintln!("interrupted; nothing was written");
        return Ok(Outcome::Interrupted);
    };
    let mut pictures = views.pictures(&gpu, &splats)?;
    let source = ExportSource::in_views(splats, &influence, &mut pictures)?;
    let Some((out, target)) = wanted else {
        return curve::run(args, &source, &mut pictures, &interrupt, output);
    };
    let chosen = match budget {
        Some(budget) => Ladder::new(&source, target, &mut pictures).choose(budget)?,
        None => Some(source.measure(target, plain(target, source.splats()), &mut pictures)?),
    };
    let Some(chosen) = chosen else {
        let name = target.name();
        let text = format!("no setting of {name} files keeps to that; ask for another format or budget");
        return Err(Error::Config(text));
    };
    engine::check(&gpu)?;
    finish(
        args,
        (out, target),
        omissions,
        source.splats().len(),
        &chosen.encoded,
        Some(&chosen.error),
    )
}

/// The usual setting of a format.
fn plain(target: ExportFormat, splats: &Splats) -> Setting {
    let degree = match target {
        ExportFormat::Splat => 0,
        _ => splats.sh_degree,
    };
    Setting {
        sh_degree: degree,
        ..Setting::default()
    }
}

/// Writes the file, and prints bytes, setting, errors and omissions.
fn finish(
    args: &ExportArgs,
    (out, target): (&Path, ExportFormat),
    omissions: Vec<String>,
    splats: usize,
    encoded: &EncodedScene,
    error: Option<&PictureError>,
) -> Result<Outcome> {
    encoded.write(out)?;
    for loss in omissions {
        eprintln!("warning: {}: {loss}", out.display());
    }
    let each = encoded.bytes as f64 / splats.max(1) as f64;
    let setting = encoded.setting.describe(target);
    let mut text = format!(
        "{}: {} bytes, {each:.2} a splat",
        out.display(),
        grouped(encoded.bytes as usize)
    );
    if let Some(error) = error {
        text += &format!(
            "\n{setting}: {:.2} dB and SSIM {:.4} against the scene's own pictures, largest difference {:.3}",
            error.psnr_db(),
            error.ssim,
            error.largest
        );
        if let Some([psnr_db, ssim]) = error.against_photos {
            text += &format!("\nagainst the photographs: {psnr_db:+.3} dB, SSIM {ssim:+.4}");
        }
    }
    Output { json: args.json }.result(text, || {
        json!({
            "file": out,
            "format": target.name(),
            "bytes": encoded.bytes,
            "bytes_per_splat": each,
            "splat_count": splats,
            "setting": setting,
            "psnr_db": error.map(PictureError::psnr_db),
            "ssim": error.map(|e| e.ssim),
            "largest": error.map(|e| e.largest),
            "photo_psnr_change_db": error.and_then(|e| e.against_photos).map(|c| c[0]),
            "photo_ssim_change": error.and_then(|e| e.against_photos).map(|c| c[1]),
        })
    });
    Ok(Outcome::Done)
}
