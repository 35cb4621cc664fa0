//! `ashfall render`: pictures of a scene, from a data set's cameras or from an orbit.

pub(super) mod orbit;
mod picture;

use super::Outcome;
use super::args::{Compat, DataArgs, DeviceArgs, SplitArg};
use super::engine::near;
use super::output::{Output, file_stem};
use super::scene::{SceneArgs, fit_axes};
use super::{engine, parse};
use crate::io::splats::readable;
use crate::render::{Compatibility, Outputs};
use crate::scene::{Camera, Dataset};
use crate::train::TrainConfig;
use crate::{Error, Result};
use clap::{Args, ValueEnum};
use serde_json::json;
use std::path::{Path, PathBuf};

pub(super) use orbit::orbit_of_cameras;

/// Draw a scene
///
/// Cameras come from a data set or a bare transforms.json (photographs need not exist), or lie on an orbit around the
/// focus of its cameras; without --cameras around the scene itself.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RenderArgs {
    #[arg(value_name = "SCENE", help = format!("The scene, {}", readable()))]
    scene: PathBuf,
    /// Folder for the pictures, made if it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Data set or transforms.json with the cameras
    #[arg(long, value_name = "DATA", required_unless_present = "orbit")]
    cameras: Option<PathBuf>,
    /// Views to draw
    #[arg(long, value_name = "SPLIT", default_value = "all")]
    split: SplitArg,
    /// N pictures around the scene instead
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    orbit: Option<u32>,
    /// png: 8 bits, over the background. exr: linear light in 32-bit floats, premultiplied with alpha (A), without
    /// background, depth of surfaces (Z, along the view axis) and their normals (N.X, N.Y, N.Z, in the world); both are
    /// NaN where alpha is below 1/2
    #[arg(long, value_name = "FORMAT", default_value = "png")]
    format: Format,
    /// Contents of a png. depth: near is bright, far is dark, over each picture's own range. normal: x right is red, y
    /// up is green, z toward the camera is blue. Both are transparent where alpha is below 1/2 [default: color]
    #[arg(long, value_name = "WHAT")]
    show: Option<Show>,
    /// Colour behind the splats of a png: black, white or R,G,B (0 to 1)
    #[arg(long, value_name = "COLOR", default_value = "black", value_parser = parse::color)]
    background: [f32; 3],
    /// Rasterization rules. engine: this program's. original: those of the 3DGS code (three standard deviations, alphas
    /// up to 0.99, the last splat of a pixel left out), as authors of scenes trained with it saw them
    #[arg(long, value_name = "RULES", default_value = "engine")]
    compat: Compat,
    /// Print JSON lines instead of text
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
  ashfall render run/scene.ply --cameras photos/ --split test --out test/
  ashfall render run/scene.ply --cameras photos/ --orbit 120 --out frames/
  ashfall render run/scene.ply --cameras path.json --format exr --out frames/";

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    Png,
    Exr,
}

/// Contents of a picture for people.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Show {
    #[default]
    Color,
    Alpha,
    Depth,
    Normal,
}

impl RenderArgs {
    /// Outputs of each frame.
    fn outputs(&self) -> Result<Outputs> {
        let original = self.compat == Compat::Original;
        let show = self.show.unwrap_or_default();
        let surface = match self.format {
            Format::Exr if self.show.is_some() => {
                return Err(Error::Config("--show is for png: an exr holds all of it".into()));
            }
            Format::Exr => !original,
            Format::Png => matches!(show, Show::Depth | Show::Normal),
        };
        if surface && original {
            let what = "--show depth and normal are by the rules of this engine: leave out --compat original";
            return Err(Error::Config(what.into()));
        }
        Ok(Outputs {
            depth: self.format == Format::Exr && original,
            surface,
            ..Outputs::default()
        })
    }
}

pub(super) fn run(args: &RenderArgs) -> Result<Outcome> {
    let output = Output { json: args.json };
    let outputs = args.outputs()?;
    let scene = args.scene_options.read(&args.scene)?;
    let cameras = args.cameras.as_deref();
    let mut dataset = cameras.map(|path| args.options.open(path, false)).transpose()?;
    if let Some(dataset) = &mut dataset {
        dataset.set_origin(scene.splats.origin);
    }
    let gpu = engine::open(&args.device)?;
    let splats = match &dataset {
        Some(dataset) => fit_axes(&args.scene, scene, &gpu, dataset, args.background)?,
        None => scene.splats,
    };
    let shots = shots(args, dataset.as_ref(), || orbit::orbit_of_splats(&splats, args.orbit))?;
    let near = match &dataset {
        Some(dataset) => near(dataset),
        None => orbit::radius(&splats) * f64::from(TrainConfig::default().near_factor),
    };
    let compatibility: Compatibility = args.compat.into();
    let mut draw = engine::scene_renderer(&gpu, &splats, near, outputs, compatibility)?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    let bar = output.bar(shots.len() as u64, "pictures");
    // An EXR has no background.
    let background = match args.format {
        Format::Png => args.background,
        Format::Exr => [0.0; 3],
    };
    for (stem, camera) in &shots {
        let picture = draw(camera, background)?;
        let path = picture::write(
            &args.out,
            stem,
            (args.format, args.show.unwrap_or_default()),
            camera,
            &picture,
        )?;
        output.event(|| json!({"event": "picture", "path": path}));
        bar.inc(1);
    }
    bar.finish_and_clear();
    engine::check(&gpu)?;
    output.result(
        format_args!("{} pictures in {}", shots.len(), args.out.display()),
        || json!({"event": "done", "pictures": shots.len(), "dir": args.out}),
    );
    Ok(Outcome::Done)
}

/// Stem of the file name and camera of each picture.
fn shots(
    args: &RenderArgs,
    dataset: Option<&Dataset>,
    around_splats: impl FnOnce() -> Vec<Camera>,
) -> Result<Vec<(String, Camera)>> {
    let numbered = |cameras: Vec<Camera>| {
        let shot = |(i, camera)| (format!("orbit_{i:04}"), camera);
        cameras.into_iter().enumerate().map(shot).collect()
    };
    let Some(dataset) = dataset else {
        return Ok(numbered(around_splats()));
    };
    let views = dataset.split(args.split.into());
    if views.is_empty() {
        let path = args.cameras.as_deref().unwrap_or(Path::new("."));
        return Err(Error::file(path, "no view belongs to that split"));
    }
    let cameras: Vec<Camera> = views.iter().map(|&i| dataset.views[i].camera).collect();
    if let Some(count) = args.orbit {
        return Ok(numbered(orbit_of_cameras(&cameras, dataset.extent(), count)));
    }
    let stems = views.iter().map(|&i| file_stem(&dataset.views[i].name));
    Ok(stems.zip(cameras).collect())
}
