//! `ashfall render`: pictures of a scene, from a data set's cameras or from an orbit.

pub(super) mod orbit;

use super::Outcome;
use super::args::{Compat, DataArgs, DeviceArgs, SplitArg};
use super::engine::near;
use super::output::{Output, file_stem};
use super::scene::{SceneArgs, fit_axes};
use super::{engine, parse};
use crate::io::splats::readable;
use crate::render::RenderedImage;
use crate::scene::{Camera, Dataset};
use crate::train::TrainConfig;
use crate::{Error, Result, io};
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
    /// png: 8 bits, over the background. exr: linear light in 32-bit floats, premultiplied with alpha (A),
    /// without background, and depth (Z, along the view axis)
    #[arg(long, value_name = "FORMAT", default_value = "png")]
    format: Format,
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

pub(super) fn run(args: &RenderArgs) -> Result<Outcome> {
    let output = Output { json: args.json };
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
    let with_depth = args.format == Format::Exr;
    let mut draw = engine::scene_renderer(&gpu, &splats, near, with_depth, args.compat.into())?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    let bar = output.bar(shots.len() as u64, "pictures");
    // An EXR has no background.
    let background = match args.format {
        Format::Png => args.background,
        Format::Exr => [0.0; 3],
    };
    for (stem, camera) in &shots {
        let picture = draw(camera, background)?;
        let path = write(&args.out, stem, args.format, &picture)?;
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

fn write(dir: &Path, stem: &str, format: Format, picture: &RenderedImage) -> Result<PathBuf> {
    let (width, height) = (picture.width, picture.height);
    match format {
        Format::Png => {
            let path = dir.join(format!("{stem}.png"));
            io::png::write_rgb(&path, width, height, &picture.rgb)?;
            Ok(path)
        }
        Format::Exr => {
            let path = dir.join(format!("{stem}.exr"));
            let pixels = picture.rgb.iter().zip(picture.alpha());
            let rgba: Vec<[f32; 4]> = pixels.map(|(rgb, alpha)| linear(*rgb, alpha)).collect();
            io::exr::write(&path, width, height, &rgba, &picture.mean_depth())?;
            Ok(path)
        }
    }
}

/// Converts display-referred colour over black to linear light, premultiplied. The curve applies to the colour without
/// coverage.
fn linear(rgb: [f32; 3], alpha: f32) -> [f32; 4] {
    let channel = |value: f32| {
        if alpha <= 0.0 {
            return 0.0;
        }
        alpha * srgb_to_linear(value / alpha)
    };
    let [r, g, b] = rgb.map(channel);
    [r, g, b, alpha]
}

/// The sRGB curve (IEC 61966-2-1), continued above 1.
fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.040_45 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exr_colours_are_linear_and_premultiplied() {
        assert_eq!(linear([1.0, 0.0, 1.0], 1.0), [1.0, 0.0, 1.0, 1.0]);
        let [half, ..] = linear([0.5, 0.0, 0.0], 0.5);
        assert_eq!(half, 0.5);
        let [grey, ..] = linear([0.5; 3], 1.0);
        assert!((grey - 0.214_041).abs() < 1e-5);
        assert_eq!(linear([0.0; 3], 0.0), [0.0; 4]);
    }
}
