//! `ashfall capture`: photographs or a video in; a data set with poses out, by COLMAP and ffmpeg.

mod frames;
mod registered;
mod tool;

use super::Outcome;
use super::output::{Output, write_text};
use crate::io::{FolderLock, colmap, photo};
use crate::{Error, Result};
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};
use tool::Tool;

/// Find the poses of photographs, or of a video's frames, with COLMAP
///
/// Runs the programs `colmap` and, for a video, `ffmpeg` (Debian and Ubuntu: packages colmap and ffmpeg) on the
/// processor, and prints each line that it runs. DATA then has images/ and sparse/0 for `ashfall train DATA`. The same
/// command goes on where an interrupted one stopped; what the programs say is in DATA/capture.log.
///
/// A hundred photographs take half an hour or more: every pair is matched. Frames of a video are matched with their
/// neighbours alone.
#[derive(Clone, Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct CaptureArgs {
    /// Folder of photographs, or a video
    #[arg(value_name = "PHOTOS|VIDEO")]
    source: PathBuf,
    /// Folder for the data set, made if it is not there
    #[arg(long, value_name = "DATA")]
    out: PathBuf,
    /// Lens of the camera [default: open-cv; simple-radial for fewer than 20 photographs]
    #[arg(long, value_name = "MODEL")]
    camera: Option<CameraArg>,
    /// Photographs are from several cameras, or were zoomed
    #[arg(long)]
    several_cameras: bool,
    /// Pairs to match [default: neighbours for a video and more than 150 photographs, else all]
    #[arg(long, value_name = "PAIRS")]
    pairs: Option<PairsArg>,
    /// Frames to keep of a video: the sharpest of each stretch
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(3..=5_000))]
    frames: u32,
    /// Longest side at which features are looked for, pixels
    #[arg(long, value_name = "PX", default_value_t = 2_000, value_parser = clap::value_parser!(u32).range(100..=20_000))]
    max_size: u32,
    /// Begin anew even if DATA holds an unfinished capture
    #[arg(long)]
    overwrite: bool,
    /// Print JSON lines instead of text
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  ashfall capture photos/ --out scene/
  ashfall capture walk.mp4 --out scene/ --frames 150
  ashfall capture action/ --out scene/ --camera fisheye
  ashfall train scene/ --out run/";

/// Camera model of COLMAP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum CameraArg {
    /// One radial coefficient, for few photographs
    SimpleRadial,
    /// Radial and tangential, for phones and cameras
    OpenCv,
    /// Wide angle and action cameras
    Fisheye,
}

impl CameraArg {
    fn model(self) -> &'static str {
        match self {
            CameraArg::SimpleRadial => "SIMPLE_RADIAL",
            CameraArg::OpenCv => "OPENCV",
            CameraArg::Fisheye => "OPENCV_FISHEYE",
        }
    }
}

/// Pairs of photographs to match.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PairsArg {
    /// Every pair
    All,
    /// Each with the fifteen next ones by name
    Neighbours,
}

/// Photographs up to which all pairs are matched.
const ALL_PAIRS_MAX: usize = 150;

/// Photographs below which a lens has one coefficient: more cannot be told apart.
const FEW_PHOTOS: usize = 20;

/// Fewest photographs of a reconstruction.
const PHOTOS_MIN: usize = 3;

/// Stages of a capture, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Stage {
    Images,
    Features,
    Matches,
    Model,
}

/// `capture.json`: source and options of a capture, and the stages that are done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct CaptureState {
    source: PathBuf,
    options: Vec<String>,
    done: Option<Stage>,
}

pub(super) fn run(args: &CaptureArgs) -> Result<Outcome> {
    let output = Output { json: args.json };
    let is_video = args.source.is_file();
    let source = args.source.canonicalize().map_err(Error::io(&args.source))?;
    // All checks come before the first write.
    let colmap = Tool::find("colmap", "colmap")?;
    let ffmpeg = is_video.then(|| Tool::find("ffmpeg", "ffmpeg")).transpose()?;
    let names = match is_video {
        true => Vec::new(),
        false => photographs(&source)?,
    };
    colmap.check_colmap()?;
    let wanted = CaptureState {
        source: source.clone(),
        options: args.summary(),
        done: None,
    };
    let earlier = match args.overwrite && args.out.join("capture.json").exists() {
        true => None,
        false => earlier(&args.out, &wanted)?,
    };
    let mut state = earlier.unwrap_or(wanted);
    std::fs::create_dir_all(&args.out).map_err(Error::io(&args.out))?;
    let _lock = FolderLock::take(&args.out)?;
    if state.done.is_none() {
        clear(&args.out)?;
    }
    let images = args.out.join("images");
    if state.done.is_none() {
        match &ffmpeg {
            Some(ffmpeg) => frames::extract(ffmpeg, &source, &args.out, args.frames, output)?,
            None => copy_photographs(&source, &names, &images)?,
        }
        finish(&mut state, Stage::Images, &args.out)?;
    }
    let count = photographs(&images)?.len();
    let steps = [
        (Stage::Features, args.features(&colmap, count)?),
        (Stage::Matches, args.matches(&colmap, count, is_video)?),
        (Stage::Model, args.model(&colmap)),
    ];
    for (stage, command) in steps {
        if state.done >= Some(stage) {
            continue;
        }
        if stage == Stage::Model {
            let sparse = args.out.join("sparse");
            if sparse.is_dir() {
                std::fs::remove_dir_all(&sparse).map_err(Error::io(&sparse))?;
            }
            std::fs::create_dir_all(&sparse).map_err(Error::io(&sparse))?;
        }
        command.run(count, &args.out, output)?;
        if stage == Stage::Model {
            registered::keep_largest(&args.out)?;
        }
        finish(&mut state, stage, &args.out)?;
    }
    let report = registered::report(&args.out)?;
    output.result(report.text(&args.out), || report.value());
    Ok(Outcome::Done)
}

impl CaptureArgs {
    /// Options that determine the result.
    fn summary(&self) -> Vec<String> {
        vec![
            format!("{:?}", self.camera),
            format!("{:?}", self.pairs),
            self.several_cameras.to_string(),
            self.frames.to_string(),
            self.max_size.to_string(),
        ]
    }

    fn features<'a>(&self, colmap: &'a Tool, count: usize) -> Result<tool::ToolCommand<'a>> {
        let usual = match count < FEW_PHOTOS {
            true => CameraArg::SimpleRadial,
            false => CameraArg::OpenCv,
        };
        let group = colmap.group("feature_extractor", ["FeatureExtraction", "SiftExtraction"])?;
        Ok(colmap
            .command("features", "feature_extractor")
            .path("--database_path", &self.out.join("database.db"))
            .path("--image_path", &self.out.join("images"))
            .option(
                "--ImageReader.single_camera",
                if self.several_cameras { "0" } else { "1" },
            )
            .option("--ImageReader.camera_model", self.camera.unwrap_or(usual).model())
            .option(&format!("--{group}.use_gpu"), "0")
            .option(&format!("--{group}.max_image_size"), &self.max_size.to_string())
            .progress("Processed file ["))
    }

    fn matches<'a>(&self, colmap: &'a Tool, count: usize, is_video: bool) -> Result<tool::ToolCommand<'a>> {
        let usual = match is_video || count > ALL_PAIRS_MAX {
            true => PairsArg::Neighbours,
            false => PairsArg::All,
        };
        let group = colmap.group("exhaustive_matcher", ["FeatureMatching", "SiftMatching"])?;
        let command = match self.pairs.unwrap_or(usual) {
            PairsArg::All => colmap.command("matches", "exhaustive_matcher"),
            PairsArg::Neighbours => colmap
                .command("matches", "sequential_matcher")
                .option("--SequentialMatching.overlap", "15"),
        };
        Ok(command
            .path("--database_path", &self.out.join("database.db"))
            .option(&format!("--{group}.use_gpu"), "0")
            .progress("Matching "))
    }

    fn model<'a>(&self, colmap: &'a Tool) -> tool::ToolCommand<'a> {
        colmap
            .command("poses", "mapper")
            .path("--database_path", &self.out.join("database.db"))
            .path("--image_path", &self.out.join("images"))
            .path("--output_path", &self.out.join("sparse"))
            .progress("Registering image #")
    }
}

/// State of an earlier capture in a folder, if there is one.
///
/// # Errors
/// One of other photographs or options.
fn earlier(out: &Path, wanted: &CaptureState) -> Result<Option<CaptureState>> {
    let path = out.join("capture.json");
    if !path.exists() {
        return match out.join("sparse").exists() {
            true => Err(Error::file(
                out,
                "holds a reconstruction that is not of `ashfall capture`: choose another --out",
            )),
            false => Ok(None),
        };
    }
    let bytes = std::fs::read(&path).map_err(Error::io(&path))?;
    let state: CaptureState =
        serde_json::from_slice(&bytes).map_err(|error| Error::file(&path, format!("cannot be read: {error}")))?;
    if state.source == wanted.source && state.options == wanted.options {
        return Ok(Some(state));
    }
    let what = "holds a capture of other photographs, or with other options: --overwrite begins anew";
    Err(Error::file(out, what))
}

/// Removes the database and the model of an earlier capture.
fn clear(out: &Path) -> Result<()> {
    for folder in ["sparse", "frames"] {
        let path = out.join(folder);
        if path.is_dir() {
            std::fs::remove_dir_all(&path).map_err(Error::io(&path))?;
        }
    }
    for file in ["database.db", "capture.log", "capture.json"] {
        let path = out.join(file);
        if path.is_file() {
            std::fs::remove_file(&path).map_err(Error::io(&path))?;
        }
    }
    Ok(())
}

fn finish(state: &mut CaptureState, stage: Stage, out: &Path) -> Result<()> {
    state.done = Some(stage);
    write_text(&out.join("capture.json"), &format!("{:#}\n", json!(state)))
}

/// Extensions of photographs, those that are refused with the command that converts them among them.
const EXTENSIONS: [&str; 14] = [
    "jpg", "jpeg", "png", "webp", "tif", "tiff", "heic", "heif", "avif", "dng", "cr2", "cr3", "nef", "arw",
];

/// Names of the photographs in a folder, sorted. All must be readable.
///
/// # Errors
/// Too few, or one that is no photograph.
pub(super) fn photographs(folder: &Path) -> Result<Vec<String>> {
    let names = photograph_names(folder)?;
    if names.len() < PHOTOS_MIN {
        let what = format!(
            "has {} photographs; {PHOTOS_MIN} are needed, and 20 or more wanted",
            names.len()
        );
        return Err(Error::file(folder, what));
    }
    for name in &names {
        photo::dimensions(&folder.join(name))?;
    }
    Ok(names)
}

/// Names of files with the extension of a photograph, sorted.
fn photograph_names(folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let name = entry.map_err(Error::io(folder))?.file_name();
        let Some(name) = name.to_str() else { continue };
        let extension = Path::new(name).extension().and_then(|e| e.to_str()).unwrap_or_default();
        if EXTENSIONS.contains(&extension.to_ascii_lowercase().as_str()) {
            names.push(name.to_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// Copies photographs as they are: poses will belong to these very pixels.
fn copy_photographs(source: &Path, names: &[String], images: &Path) -> Result<()> {
    std::fs::create_dir_all(images).map_err(Error::io(images))?;
    if images.canonicalize().map_err(Error::io(images))? == source {
        return Ok(());
    }
    for other in photograph_names(images)?.iter().filter(|other| !names.contains(other)) {
        let path = images.join(other);
        std::fs::remove_file(&path).map_err(Error::io(&path))?;
    }
    for name in names {
        let to = images.join(name);
        std::fs::copy(source.join(name), &to).map_err(Error::io(&to))?;
    }
    Ok(())
}

/// Hint for a folder of photographs without poses; `None` for other folders.
pub(super) fn hint(folder: &Path) -> Option<String> {
    let inner = folder.join("images");
    let photos = [folder, inner.as_path()]
        .into_iter()
        .find(|f| !photograph_names(f).unwrap_or_default().is_empty())?;
    let count = photograph_names(photos).ok()?.len();
    Some(format!(
        "has {count} photographs but no poses: find them first with `ashfall capture {} --out DATA`, then train on DATA",
        photos.display()
    ))
}

/// Whether a model is there.
fn has_model(out: &Path) -> bool {
    colmap::find_model(out).is_some()
}
