//! `ashfall export`: a scene in another format, in as few bytes as its picture needs.

use super::args::{DataArgs, DeviceArgs};
use super::engine::evaluator;
use super::interrupt::Interrupt;
use super::output::{Output, grouped};
use super::render::orbit;
use super::scene::{SceneArgs, fit_axes};
use super::{Outcome, engine, parse};
use crate::export::{Budget, Influence, Ladder, Measured, PictureError, Pictures, Setting, Source, Target};
use crate::gpu::Gpu;
use crate::io::splats::{losses, readable};
use crate::render::{Compatibility, ViewOptions};
use crate::scene::{Camera, Dataset, PhotoSource, Splats, Split};
use crate::simplify::PassOptions;
use crate::train::TrainConfig;
use crate::{Error, Result};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Write a scene in another format
///
/// With DATA, harmonics are rounded together, so that colours are right in the directions of the training cameras: files
/// of the same format and length that lose less. --loss and --bytes choose the settings of the format by rendered
/// views, up to eight of those trained on. Without DATA the views lie on a
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
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[arg(long, value_name = "FORMAT", help = format!(
        "Format whatever the name: {}",
        Target::names().collect::<Vec<_>>().join(", ")
    ), value_parser = target)]
    format: Option<Target>,
    /// Fewest bytes that lose no more than DB decibels against the photographs; without photographs, no more than a
    /// scene of 30 dB would lose
    #[arg(long, value_name = "DB", value_parser = parse::loss)]
    loss: Option<f64>,
    /// Least error within N bytes, e.g. 2M
    #[arg(long, value_name = "N", value_parser = parse::size, conflicts_with = "loss")]
    bytes: Option<u64>,
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
  ashfall export theirs.sog --out scene.ply";

fn target(name: &str) -> std::result::Result<Target, String> {
    let names = || Target::names().collect::<Vec<_>>().join(", ");
    Target::parse(name).ok_or_else(|| format!("formats are {}", names()))
}

/// Views by whose directions harmonics are rounded, at most.
const DIRECTIONS_MAX: usize = 48;

/// Views that are rendered to compare settings, at most.
const COMPARED_MAX: usize = 8;

/// Views on a sphere around a scene without cameras.
const SPHERE_VIEWS: u32 = 24;

pub(super) fn run(args: &ExportArgs) -> Result<Outcome> {
    let target = args.format.map_or_else(|| Target::of(&args.out), Ok)?;
    let output = Output { json: args.json };
    let loaded = args.scene_options.read(&args.scene)?;
    for loss in losses(&args.out, &loaded.splats) {
        eprintln!("warning: {}: {loss}", args.out.display());
    }
    let budget = args.loss.map(Budget::Loss).or(args.bytes.map(Budget::Bytes));
    if args.data.is_none() && budget.is_none() {
        let source = Source::new(&loaded.splats, None);
        let encoded = source.encode(target, plain(target, &loaded.splats))?;
        encoded.write(&args.out)?;
        report(args, target, encoded.bytes, loaded.splats.len(), None, output);
        return Ok(Outcome::Done);
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
    let source = Source::new(&splats, Some(&influence));
    let mut pictures = views.pictures(&gpu, source.splats())?;
    let chosen = match budget {
        Some(budget) => Ladder::new(&source, target, &mut pictures).choose(budget)?,
        None => Some(measured(&source, target, plain(target, &splats), &mut pictures)?),
    };
    let Some(chosen) = chosen else {
        return Err(Error::Config(format!(
            "no setting of {} files keeps to that; ask for another format or budget",
            target.name()
        )));
    };
    chosen.encoded.write(&args.out)?;
    engine::check(&gpu)?;
    report(args, target, chosen.encoded.bytes, splats.len(), Some(&chosen), output);
    Ok(Outcome::Done)
}

/// The usual setting of a format.
fn plain(target: Target, splats: &Splats) -> Setting {
    let degree = match target {
        Target::Splat => 0,
        _ => splats.sh_degree,
    };
    Setting {
        sh_degree: degree,
        ..Setting::default()
    }
}

fn measured(source: &Source, target: Target, setting: Setting, pictures: &mut Pictures<'_>) -> Result<Measured> {
    let encoded = source.encode(target, setting)?;
    let error = pictures.error(&encoded.decode())?;
    Ok(Measured { encoded, error })
}

/// Cameras of an export.
struct Views<'a> {
    dataset: Option<&'a Dataset>,
    /// Training views, or those on a sphere.
    cameras: Vec<Camera>,
    /// Indices in the data set, if there is one.
    indices: Vec<usize>,
    options: ViewOptions,
}

/// Most pixels of a picture by which settings are compared.
const COMPARED_PIXELS_MAX: f64 = 1e6;

impl<'a> Views<'a> {
    fn new(args: &ExportArgs, dataset: Option<&'a Dataset>, splats: &Splats) -> Result<Views<'a>> {
        let (near, cameras, indices) = match dataset {
            Some(dataset) => {
                let indices = dataset.split(Split::Train);
                if indices.is_empty() {
                    let path = args.data.as_deref().unwrap_or(Path::new("."));
                    return Err(Error::file(path, "holds no training view"));
                }
                let cameras = indices.iter().map(|&i| dataset.views[i].camera).collect();
                (engine::near(dataset), cameras, indices)
            }
            None => {
                let near = orbit::radius(splats) * f64::from(TrainConfig::default().near_factor);
                (near, orbit::sphere_of_splats(splats, SPHERE_VIEWS), Vec::new())
            }
        };
        Ok(Views {
            dataset,
            cameras,
            indices,
            options: ViewOptions {
                background: args.background,
                near: near as f32,
                filter: splats.filter,
            },
        })
    }

    /// Weights of the splats in the views.
    fn influence(&self, gpu: &Gpu, splats: &Splats, interrupt: &Interrupt) -> Result<Option<Influence>> {
        let options = PassOptions {
            near: self.options.near,
            background: self.options.background,
            compatibility: Compatibility::Engine,
        };
        let cameras: Vec<Camera> = spread(self.cameras.len(), DIRECTIONS_MAX)
            .map(|i| self.cameras[i])
            .collect();
        Influence::measure(gpu, splats, &cameras, options, || !interrupt.is_requested())
    }

    /// Pictures by which settings are compared.
    fn pictures(&self, gpu: &Gpu, splats: &Splats) -> Result<Pictures<'a>> {
        let chosen: Vec<usize> = spread(self.cameras.len(), COMPARED_MAX).collect();
        let photos = self.dataset.and_then(|dataset| {
            let indices: Vec<usize> = chosen.iter().map(|&i| self.indices[i]).collect();
            let is_there = |&i: &usize| !matches!(dataset.views[i].photo, PhotoSource::Absent);
            let all = indices.iter().all(is_there);
            all.then(|| evaluator(gpu, dataset, &indices, self.options.background))
        });
        let cameras = chosen.iter().map(|&i| small(&self.cameras[i])).collect();
        Pictures::new(gpu, splats, cameras, self.options, photos)
    }
}

/// Up to `most` of the numbers below `count`, evenly spread.
fn spread(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let chosen = count.min(most);
    (0..chosen).map(move |i| (2 * i + 1) * count / (2 * chosen))
}

/// The same view in a picture of limited size.
fn small(camera: &Camera) -> Camera {
    let pixels = f64::from(camera.width) * f64::from(camera.height);
    let scale = (COMPARED_PIXELS_MAX / pixels).sqrt().min(1.0);
    let side = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
    camera.resized(side(camera.width), side(camera.height))
}

/// Prints file, bytes, setting and errors.
fn report(args: &ExportArgs, target: Target, bytes: u64, splats: usize, chosen: Option<&Measured>, output: Output) {
    let each = bytes as f64 / splats.max(1) as f64;
    let mut text = format!(
        "{}: {} bytes, {each:.2} a splat",
        args.out.display(),
        grouped(bytes as usize)
    );
    if let Some(Measured { encoded, error }) = chosen {
        text += &format!(
            "\n{}: {:.2} dB and SSIM {:.4} against the scene's own pictures, largest difference {:.3}",
            encoded.setting.describe(target),
            error.psnr_db(),
            error.ssim,
            error.largest
        );
        if let Some([psnr_db, ssim]) = error.against_photos {
            text += &format!("\nagainst the photographs: {psnr_db:+.3} dB, SSIM {ssim:+.4}");
        }
    }
    output.result(text, || {
        let error = chosen.map(|m| &m.error);
        json!({
            "file": args.out,
            "format": target.name(),
            "bytes": bytes,
            "bytes_per_splat": each,
            "splat_count": splats,
            "setting": chosen.map(|m| m.encoded.setting.describe(target)),
            "psnr_db": error.map(PictureError::psnr_db),
            "ssim": error.map(|e| e.ssim),
            "largest": error.map(|e| e.largest),
            "photo_psnr_change_db": error.and_then(|e| e.against_photos).map(|c| c[0]),
            "photo_ssim_change": error.and_then(|e| e.against_photos).map(|c| c[1]),
        })
    });
}
