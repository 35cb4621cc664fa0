//! `ashfall info`: description of the devices, a scene or a data set.

mod describe;
mod exposures;

use super::Outcome;
use super::args::{DataArgs, DeviceArgs, check_capture};
use super::cameras::CameraPairs;
use super::configure::ConfigArgs;
use super::engine;
use super::output::{Output, bytes, grouped};
use super::predict::PredictArgs;
use super::scene::SceneArgs;
use crate::io::LoadedSplats;
use crate::io::dataset::Reconstruction;
use crate::io::splats::readable;
use crate::render::{Blocks, Slots};
use crate::scene::{Dataset, PhotoSource, Split, View};
use crate::simplify::for_auto_count;
use crate::train::BufferLimits;
use crate::train::exposure::TrackColors;
use crate::{Error, Result};
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Describe the devices, a scene or a data set, or predict a run's memory
///
/// Without a path: the Vulkan devices, the capabilities of the chosen one, and the kernel variants used on it. Of a
/// COLMAP data set also the exposures of its training photographs, from the tracks of its points.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct InfoArgs {
    #[arg(value_name = "PATH", help = format!("A scene ({}) or a data set", readable()))]
    path: Option<PathBuf>,
    /// Compare the training cameras of a data set with those of the same names in this one, after the best similarity
    #[arg(long, value_name = "DATA")]
    cameras: Option<PathBuf>,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    predict: PredictArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    scene_options: SceneArgs,
    #[command(flatten)]
    options: DataArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

const EXAMPLES: &str = "\
Examples:
  ashfall info
  ashfall info --device llvmpipe --json
  ashfall info run/scene.ply
  ashfall info photos/
  ashfall info photos/ --cameras run/refined
  ashfall info photos/ --predict --strategy mcmc --max-splats 500000
  ashfall info --predict --splats 2000000 --photos 300 --size 1600x1200
  ashfall info run/scene.ply --predict --size 3840x2160";

pub(super) fn run(args: &InfoArgs) -> Result<Outcome> {
    if args.predict.predict {
        return predict(args);
    }
    if args.config != ConfigArgs::default() {
        return Err(Error::Config("options of training are for --predict here".into()));
    }
    let (text, value) = match &args.path {
        None => devices(&args.device)?,
        Some(path) if is_scene(path) => scene(&args.scene_options.read(path)?),
        Some(path) => {
            let mut opened = args.options.open(path, false)?;
            let found = check_capture(path, &opened)?;
            opened.warnings.extend(found);
            if let Some(warning) = absent_photos(path, &opened) {
                eprintln!("warning: {warning}");
                opened.warnings.push(warning);
            }
            let (mut text, mut value) = dataset(&opened)?;
            if let Some(other) = &args.cameras {
                let (line, compared) = CameraPairs::read(&opened, &args.options, other)?.describe();
                text += &format!("\n{line}");
                value["cameras"] = compared;
            }
            (text, value)
        }
    };
    Output { json: args.json }.result(text, || value);
    Ok(Outcome::Done)
}

fn predict(args: &InfoArgs) -> Result<Outcome> {
    let gpu = engine::open(&args.device)?;
    let (limit, limits) = (gpu.memory_limit(), BufferLimits::of(&gpu));
    let kind = gpu.caps().kind;
    let prediction = match &args.path {
        None => args.predict.on_numbers(&args.config.config(kind)?, limits),
        Some(path) if is_scene(path) => args.predict.on_scene(&args.scene_options.read(path)?.splats, limits)?,
        Some(path) => {
            let dataset = args.options.open(path, false)?;
            let config = args.config.config_from(kind, |usual| match args.predict.parsimony {
                true => for_auto_count(usual, dataset.views_per_point()),
                false => usual.for_dataset(&dataset),
            })?;
            args.predict.on_dataset(&dataset, &config, limits)
        }
    };
    Output { json: args.json }.result(prediction.table(limit), || prediction.value());
    Ok(Outcome::Done)
}

/// Number of views without their photograph, and the first of them.
fn absent_photos(path: &Path, dataset: &Dataset) -> Option<String> {
    let is_absent = |view: &&View| matches!(view.photo, PhotoSource::Absent);
    let absent: Vec<&View> = dataset.views.iter().filter(is_absent).collect();
    let first = absent.first()?;
    Some(format!(
        "{}: {} of {} photographs are missing, the first is {}",
        path.display(),
        absent.len(),
        dataset.views.len(),
        first.name
    ))
}

fn is_scene(path: &Path) -> bool {
    // A folder is a data set by any name.
    path.is_file() && !Reconstruction::is_file(path)
}

fn devices(args: &DeviceArgs) -> Result<(String, Value)> {
    let (list, list_value) = describe::devices()?;
    let gpu = engine::open(args)?;
    let (chosen, chosen_value) = describe::chosen(gpu.caps(), gpu.memory_limit());
    let value = json!({"devices": list_value, "chosen": chosen_value});
    Ok((format!("{list}\n{chosen}"), value))
}

fn scene(LoadedSplats { splats, stored, .. }: &LoadedSplats) -> (String, Value) {
    let axes = [0, 1, 2].map(|axis| {
        let values = || splats.mean.iter().map(|m| m[axis]).filter(|v| v.is_finite());
        [
            values().fold(f32::INFINITY, f32::min),
            values().fold(f32::NEG_INFINITY, f32::max),
        ]
    });
    let faint = splats
        .opacity_logit
        .iter()
        .filter(|&&logit| logit < FAINT_LOGIT)
        .count();
    let blocks = Blocks::anywhere(Slots::of_scene(splats).counts);
    let size = (size_of::<[f32; 4]>() * blocks.vectors()) as u64;
    let text = format!(
        "format:      {}, axes {}\nsplats:      {}, kind {}\nSH degree:   {}\nmode:        {:?}\n\
         means:       x {:?}, y {:?}, z {:?}\n\
         faint:       {} (opacity below 1/255: never drawn)\non a device: {}",
        stored.format,
        stored.axes,
        grouped(splats.len()),
        splats.primitive.name(),
        splats.sh_degree,
        splats.filter,
        axes[0],
        axes[1],
        axes[2],
        grouped(faint),
        bytes(size),
    );
    let value = json!({
        "format": stored.format,
        "axes": stored.axes.to_string(),
        "splat_count": splats.len(),
        "sh_degree": splats.sh_degree,
        "kind": splats.primitive.name(),
        "mode": splats.filter.name(),
        "bounds": axes,
        "faint_count": faint,
        "device_bytes": size,
    });
    (text, value)
}

/// Logit of 1/255, below which a splat is not drawn: −ln 254.
const FAINT_LOGIT: f32 = -5.537_334_3;

fn dataset(dataset: &Dataset) -> Result<(String, Value)> {
    let (train, test) = (dataset.split(Split::Train).len(), dataset.split(Split::Test).len());
    let mut sizes: Vec<[u32; 2]> = dataset
        .views
        .iter()
        .map(|v| [v.camera.width, v.camera.height])
        .collect();
    sizes.sort_unstable();
    sizes.dedup();
    let size_text: Vec<String> = sizes.iter().take(5).map(|[w, h]| format!("{w}×{h}")).collect();
    let pixels = dataset
        .views
        .iter()
        .map(|v| u64::from(v.camera.width) * u64::from(v.camera.height));
    let photo_bytes = 4 * pixels.sum::<u64>();
    let mut text = format!(
        "views:    {} ({train} to train on, {test} held out)\nsizes:    {}{}\n\
         points:   {}, each in {} training images (median)\nextent:   {:.4} world units\n\
         alpha:    {:?}\ndecoded:  {}",
        dataset.views.len(),
        size_text.join(", "),
        if sizes.len() > 5 { ", …" } else { "" },
        grouped(dataset.points.len()),
        dataset.views_per_point(),
        dataset.extent(),
        dataset.alpha,
        bytes(photo_bytes),
    );
    let colors = TrackColors::read(dataset)?;
    let exposure = exposures::describe(dataset, &colors).map(|(table, value)| {
        text += &format!("\n{table}");
        value
    });
    let vignetting = exposures::vignetting(&colors).map(|(line, value)| {
        text += &format!("\n{line}");
        value
    });
    let value = json!({
        "views": dataset.views.len(),
        "train_views": train,
        "test_views": test,
        "sizes": sizes,
        "points": dataset.points.len(),
        "views_per_point": dataset.views_per_point(),
        "extent": dataset.extent(),
        "alpha": format!("{:?}", dataset.alpha).to_lowercase(),
        "photo_bytes": photo_bytes,
        "exposure": exposure,
        "vignetting": vignetting,
        "warnings": dataset.warnings,
    });
    Ok((text, value))
}
