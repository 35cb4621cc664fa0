//! `ashfall render`: pictures of a scene, from a data set's cameras, along a path or around it.

mod finished;
pub(super) mod orbit;
mod panorama;
pub(super) mod picture;
mod sequence;

use super::Outcome;
use super::args::{Compat, DataArgs, DeviceArgs, SplitArg};
use super::engine::near;
use super::interrupt::Interrupt;
use super::output::Output;
use super::scene::{SceneArgs, fit_axes};
use super::{engine, parse};
use crate::io::splats::readable;
use crate::io::video::{VideoLayout, VideoWriter};
use crate::render::{Outputs, RenderOptions, RenderedImage, SplatOrder};
use crate::scene::{Axes, Camera, Projection};
use crate::train::TrainConfig;
use crate::{Error, Result};
use clap::{Args, ValueEnum};
use finished::{FrameLog, JobDigest, Reuse};
use glam::DVec2;
use panorama::Panorama;
use picture::PictureForm;
use sequence::Sequence;
use serde_json::json;
use std::path::{Path, PathBuf};

pub(super) use orbit::orbit_of_cameras;

/// Draw a scene
///
/// Cameras come from a data set or a bare transforms.json (photographs need not exist), from a path, or lie on an orbit
/// around the focus of the data set's cameras; without --cameras around the scene itself, upright if its file tells the
/// upward direction.
///
/// A command that was stopped goes on with the first missing picture: pictures that it would draw again are kept.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RenderArgs {
    #[arg(value_name = "SCENE", help = format!("The scene, {}", readable()))]
    scene: PathBuf,
    /// Folder for the pictures, made if it is not there; -: frames of a video on standard output, by --format
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Data set or transforms.json with the cameras
    #[arg(long, value_name = "DATA", required_unless_present_any = ["orbit", "path"])]
    cameras: Option<PathBuf>,
    /// Pictures along a path instead: nerfstudio's camera_path.json (with dataparser_transforms.json beside it for a
    /// scene in the world of its data set), cameras.json of the 3DGS code, transforms.json, cameras of a .gltf or .glb
    /// file, or a COLMAP model without photographs. With --cameras, the near plane is that of the data set
    #[arg(long, value_name = "FILE", conflicts_with = "orbit")]
    path: Option<PathBuf>,
    /// N pictures between any two cameras of the path, on a smooth curve through them
    #[arg(long, value_name = "N", requires = "path", value_parser = clap::value_parser!(u32).range(..=10_000))]
    between: Option<u32>,
    /// Go on from the last camera of the path to its first, with --between
    #[arg(long, requires = "between")]
    closed: bool,
    /// Axes of the path's world, directions of x, y and z: L or R, U or D, F or B each [default: LUF for glTF, RDF for
    /// others]
    #[arg(long, value_name = "AXES", requires = "path", value_parser = parse::axes)]
    path_axes: Option<Axes>,
    /// Size of the pictures, with the same vertical field of view [default: that of the cameras]
    #[arg(long, value_name = "WxH", value_parser = parse::image_size)]
    size: Option<[u32; 2]>,
    /// Pictures of the whole sphere around each camera, in equirectangular projection with the camera's axis in the
    /// middle, of --size [default: 2048x1024]
    #[arg(long)]
    panorama: bool,
    /// Orthographic pictures, HEIGHT world units high, along the cameras' axes from their places on
    #[arg(long, value_name = "HEIGHT", value_parser = parse::positive, conflicts_with = "panorama")]
    orthographic: Option<f64>,
    /// Frames a second, of a y4m stream and of an animated glTF camera [default: the path's, or 30]
    #[arg(long, value_name = "RATE", value_parser = parse::rate)]
    fps: Option<f64>,
    /// Views to draw
    #[arg(long, value_name = "SPLIT", default_value = "all")]
    split: SplitArg,
    /// N pictures around the scene instead
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    orbit: Option<u32>,
    /// png: over the background. exr: linear light in 32-bit floats, premultiplied with alpha (A), without
    /// background, depth of surfaces (Z, along the view axis) and their normals (N.X, N.Y, N.Z, in the world); both are
    /// NaN where alpha is below 1/2. With --out -: y4m (4:4:4, 8 bits, BT.709, limited range) or rgb24 (bare bytes)
    #[arg(long, value_name = "FORMAT", default_value = "png")]
    format: Format,
    /// Bits of each channel of a png
    #[arg(long, value_name = "BITS", default_value = "8")]
    bits: BitDepth,
    /// Keep every picture that exists, of whichever scene and camera
    #[arg(long)]
    skip_existing: bool,
    /// Draw all pictures again
    #[arg(long, conflicts_with = "skip_existing")]
    overwrite: bool,
    /// Contents of a png or a frame. depth: near is bright, far is dark, over each picture's own range. normal: x right
    /// is red, y up is green, z toward the camera is blue. Both are transparent where alpha is below 1/2 [default:
    /// color]
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
  ashfall render run/scene.ply --cameras path.json --format exr --out frames/
  ashfall render run/scene.ply --path camera_path.json --between 29 --out frames/
  ashfall render run/scene.ply --orbit 240 --format y4m --out - | ffmpeg -i - orbit.mp4";

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    Png,
    Exr,
    Y4m,
    Rgb24,
}

/// Bits of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum BitDepth {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
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
    /// Layout of the video on standard output, if that is asked for.
    fn video(&self) -> Result<Option<VideoLayout>> {
        let is_stream = self.out == Path::new("-");
        let layout = match self.format {
            Format::Y4m => Some(VideoLayout::Y4m),
            Format::Rgb24 => Some(VideoLayout::Rgb24),
            Format::Png | Format::Exr => None,
        };
        let fault = match (is_stream, layout) {
            (true, None) => Some("--out - needs --format y4m or rgb24"),
            (false, Some(_)) => Some("--format y4m and rgb24 go to standard output: they need --out -"),
            _ if is_stream && self.json => Some("--json and --out - both need standard output"),
            _ if self.bits == BitDepth::Sixteen && self.format != Format::Png => Some("--bits 16 is for png"),
            _ => None,
        };
        fault.map_or(Ok(layout), |fault| Err(Error::Config(fault.into())))
    }

    /// Form of the pictures.
    fn form(&self) -> PictureForm {
        PictureForm {
            format: self.format,
            show: self.show.unwrap_or_default(),
            bits: self.bits,
        }
    }

    /// Pictures that are kept.
    fn reuse(&self) -> Reuse {
        match (self.skip_existing, self.overwrite) {
            (true, _) => Reuse::Existing,
            (_, true) => Reuse::Nothing,
            _ => Reuse::Equal,
        }
    }

    /// Options of the renderer.
    fn render_options(&self, outputs: Outputs) -> RenderOptions {
        RenderOptions {
            with_depth: outputs.depth,
            with_surface: outputs.surface,
            compatibility: self.compat.into(),
            order: match self.panorama {
                true => SplatOrder::Distance,
                false => SplatOrder::Depth,
            },
            projection: match self.orthographic {
                Some(_) => Projection::Orthographic,
                None => Projection::Perspective,
            },
            ..RenderOptions::default()
        }
    }

    /// A camera with the focal lengths of the pictures' projection.
    fn projected(&self, camera: &Camera) -> Camera {
        let focal = self
            .orthographic
            .map(|height| DVec2::splat(f64::from(camera.height) / height));
        Camera {
            focal: focal.unwrap_or(camera.focal),
            ..*camera
        }
    }

    /// Outputs of each frame.
    fn outputs(&self) -> Result<Outputs> {
        let original = self.compat == Compat::Original;
        let show = self.show.unwrap_or_default();
        let surface = match self.format {
            Format::Exr if self.show.is_some() => {
                return Err(Error::Config("--show is for png: an exr holds all of it".into()));
            }
            Format::Exr => !original && self.orthographic.is_none(),
            Format::Png | Format::Y4m | Format::Rgb24 => matches!(show, Show::Depth | Show::Normal),
        };
        if surface && original {
            let what = "--show depth and normal are by the rules of this engine: leave out --compat original";
            return Err(Error::Config(what.into()));
        }
        if self.orthographic.is_some() && (surface || original) {
            let what =
                "--orthographic is of colours and alpha, and of depths of means in an exr, by the rules of this engine";
            return Err(Error::Config(what.into()));
        }
        if self.panorama && (surface || original || self.format == Format::Exr) {
            let what = "--panorama is of colours or alpha, by the rules of this engine, and no exr";
            return Err(Error::Config(what.into()));
        }
        Ok(Outputs {
            depth: self.format == Format::Exr && !surface,
            surface,
            ..Outputs::default()
        })
    }
}

pub(super) fn run(args: &RenderArgs) -> Result<Outcome> {
    let (outputs, video) = (args.outputs()?, args.video()?);
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
    let mut sequence = Sequence::of(args, dataset.as_ref(), &splats)?;
    let panorama = args.panorama.then(|| Panorama::new(args.size.unwrap_or(PANORAMA_SIZE)));
    if let (Some(_), Some((_, first))) = (video, sequence.pictures.first()) {
        // Frames of a stream have one size.
        let (width, height) = (first.width, first.height);
        sequence = sequence.with_size(width, height);
    }
    let near = match &dataset {
        Some(dataset) => near(dataset),
        None => orbit::radius(&splats) * f64::from(TrainConfig::default().near_factor),
    };
    let mut pinhole = engine::renderer_with(&gpu, &splats, near, args.render_options(outputs))?;
    let draw = |camera: &Camera, background| match &panorama {
        Some(panorama) => panorama.draw(camera, |part| pinhole(part, background)),
        None => pinhole(&args.projected(camera), background),
    };
    let outcome = match video {
        Some(layout) => stream(args, (layout, panorama.as_ref().map(Panorama::size)), &sequence, draw)?,
        None => {
            let size = panorama.as_ref().map(Panorama::size);
            let options = format!(
                "{near} {:?} {:?} {:?} {size:?}{}",
                args.form(),
                args.compat,
                args.background,
                args.orthographic.map_or(String::new(), |height| format!(" {height}"))
            );
            let digest = JobDigest::new(&splats, &format!("{options} {}", gpu.caps().name));
            write(args, &sequence, &digest, draw)?
        }
    };
    engine::check(&gpu)?;
    Ok(outcome)
}

/// Size of panoramas where none is asked for.
const PANORAMA_SIZE: [u32; 2] = [2048, 1024];

/// Notice of a request to stop.
const STOPPING: &str = "stopping after this picture; Ctrl-C stops at once";

/// Writes the pictures that are not there.
fn write(
    args: &RenderArgs,
    sequence: &Sequence,
    digest: &JobDigest,
    mut draw: impl FnMut(&Camera, [f32; 3]) -> Result<RenderedImage>,
) -> Result<Outcome> {
    let output = Output { json: args.json };
    let interrupt = Interrupt::listen_with(STOPPING)?;
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    let (log, form) = (FrameLog::open(&args.out, args.reuse()), args.form());
    let count = sequence.pictures.len();
    let bar = output.bar(count as u64, "pictures");
    // An EXR has no background.
    let background = match args.format {
        Format::Exr => [0.0; 3],
        _ => args.background,
    };
    let (mut drawn, mut kept) = (0, 0);
    for (stem, camera) in &sequence.pictures {
        let (name, digest) = (form.file_name(stem), digest.of(camera));
        if log.keeps(&name, digest) {
            kept += 1;
            bar.inc(1);
            continue;
        }
        if interrupt.is_requested() {
            bar.finish_and_clear();
            output.remark(format_args!(
                "stopped after {} of {count} pictures; the same command draws the others",
                drawn + kept
            ));
            return Ok(Outcome::Interrupted);
        }
        let path = log.path(&name);
        form.write(&path, camera, &draw(camera, background)?)?;
        log.add(&name, digest)?;
        output.event(|| json!({"event": "picture", "path": path}));
        drawn += 1;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let there = match kept {
        0 => String::new(),
        _ => format!(", {kept} of them there before"),
    };
    output.result(
        format_args!("{count} pictures in {}{there}", args.out.display()),
        || json!({"event": "done", "pictures": count, "kept": kept, "dir": args.out}),
    );
    Ok(Outcome::Done)
}

/// Writes all pictures to standard output.
fn stream(
    args: &RenderArgs,
    (layout, size): (VideoLayout, Option<[u32; 2]>),
    sequence: &Sequence,
    mut draw: impl FnMut(&Camera, [f32; 3]) -> Result<RenderedImage>,
) -> Result<Outcome> {
    let Some((_, first)) = sequence.pictures.first() else {
        return Ok(Outcome::Done);
    };
    let interrupt = Interrupt::listen_with(STOPPING)?;
    let output = Output { json: false };
    let bar = output.bar(sequence.pictures.len() as u64, "pictures");
    let rate = args.fps.or(sequence.rate).unwrap_or(30.0);
    let fault = |error| Error::io(Path::new("standard output"))(error);
    let stdout = std::io::stdout().lock();
    let size = size.unwrap_or([first.width, first.height]);
    let mut video = VideoWriter::new(stdout, layout, size, rate).map_err(fault)?;
    for (_, camera) in &sequence.pictures {
        if interrupt.is_requested() {
            bar.finish_and_clear();
            return Ok(Outcome::Interrupted);
        }
        let picture = draw(camera, args.background)?;
        video
            .frame(&args.form().frame(camera, &picture, args.background))
            .map_err(fault)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(Outcome::Done)
}
