//! Options that several commands share.

use super::capture;
use super::parse;
use crate::io::dataset::{self, MaskUse, OpenOptions, Reconstruction};
use crate::render::Compatibility;
use crate::scene::{AlphaMode, Dataset, Split};
use crate::train::exposure::{LensVignetting, remove_vignetting};
use crate::{Error, Result};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};

/// Device selection and limits.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Device")]
pub(super) struct DeviceArgs {
    /// Vulkan device: its index in `ashfall info`, or a part of its name [default: the fastest kind]
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// Limit of device memory, e.g. 2G or 512M [default: all memory of the device]
    #[arg(long, value_name = "SIZE", value_parser = parse::size)]
    pub memory_limit: Option<u64>,
    /// Have the validation layer check every Vulkan call; its messages are errors (slow)
    #[arg(long)]
    pub validate: bool,
    /// Test limit on the bytes that a binding reaches
    #[arg(long, value_name = "SIZE", value_parser = parse::size, hide = true)]
    pub limit_binding: Option<u64>,
    /// Test limit on the invocations of a workgroup
    #[arg(long, value_name = "N", hide = true)]
    pub limit_workgroup: Option<u32>,
    /// Test without subgroup operations
    #[arg(long, hide = true)]
    pub without_subgroups: bool,
}

/// Options for reading a data set.
#[derive(Clone, Debug, PartialEq, Eq, Args, serde::Serialize, serde::Deserialize)]
#[command(next_help_heading = "Data set")]
pub(super) struct DataArgs {
    /// Reduce the photographs by this factor in width and height
    #[arg(long, value_name = "K", default_value_t = 1)]
    pub downscale: u32,
    /// Hold out every N-th photograph by name, from the first, as test view; 0: none
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub test_every: usize,
    /// Folder of the photographs, in the data set or else in the working directory [default: the data set format's]
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
    /// Meaning of alpha: over the background, or weight of the pixel [default: composite; mask for distorted
    /// photographs, because undistortion leaves empty borders]
    #[arg(long, value_name = "MODE")]
    pub alpha: Option<AlphaArg>,
    /// Mask files: masks/NAME.jpg.png or masks/NAME.png beside the photographs, mask_path of nerfstudio
    #[arg(long, value_name = "USE", default_value = "ignore")]
    #[serde(default)]
    pub masks: MasksArg,
    /// Remove the vignetting of the lens from all photographs, where the points' tracks tell it
    #[arg(long)]
    #[serde(default)]
    pub vignetting: bool,
}

impl Default for DataArgs {
    fn default() -> DataArgs {
        DataArgs {
            downscale: 1,
            test_every: 8,
            images: None,
            alpha: None,
            masks: MasksArg::Ignore,
            vignetting: false,
        }
    }
}

impl DataArgs {
    /// Absolute path of `--images`: the data set's folder of that name if there is one, else the working directory's.
    pub(crate) fn photo_folder(&self, data: &Path) -> Result<Option<PathBuf>> {
        let Some(name) = &self.images else {
            return Ok(None);
        };
        let own = dataset::photo_folder(data, name);
        let folder = match name.is_dir() && !own.is_dir() {
            true => name,
            false => &own,
        };
        std::path::absolute(folder).map(Some).map_err(Error::io(folder))
    }

    /// Opens the data set at `path` and prints the repairs and omissions.
    pub(crate) fn open(&self, path: &Path, photos_required: bool) -> Result<Dataset> {
        let options = OpenOptions {
            downscale: self.downscale,
            test_every: self.test_every,
            images: self.photo_folder(path)?,
            alpha: self.alpha.map(AlphaMode::from),
            photos_required,
            masks: match self.masks {
                MasksArg::Ignore => MaskUse::Ignore,
                MasksArg::Inverted => MaskUse::Inverted,
                MasksArg::Off => MaskUse::Off,
            },
        };
        let mut dataset = dataset::open(path, &options).map_err(|error| match capture_hint(path) {
            Some(hint) => Error::file(path, hint),
            None => error,
        })?;
        for warning in &dataset.warnings {
            eprintln!("warning: {warning}");
        }
        if self.vignetting {
            for lens in remove_vignetting(&mut dataset).map_err(|error| Error::file(path, error.to_string()))? {
                eprintln!("{}", vignetting_line(&lens));
            }
        }
        Ok(dataset)
    }
}

/// Vignetting of a lens as text.
pub(super) fn vignetting_line(lens: &LensVignetting) -> String {
    let [width, height] = lens.size;
    match lens.is_clear() {
        true => format!(
            "vignetting: corners of {width}×{height} are {:.2} ± {:.2} stops darker",
            -lens.vignetting.corner_stops(),
            lens.error_stops
        ),
        false => format!("vignetting: none of {width}×{height} that the points' tracks tell"),
    }
}

/// Advice for a folder of photographs without any reconstruction.
fn capture_hint(path: &Path) -> Option<String> {
    let is_without_poses = matches!(Reconstruction::find(path), Ok(None));
    match path.is_dir() && is_without_poses {
        true => capture::hint(path),
        false => None,
    }
}

/// Prints a warning for each usual mistake of captures that the photographs show, and returns the warnings.
pub(super) fn check_capture(path: &Path, dataset: &Dataset) -> Result<Vec<String>> {
    let found = dataset::check_capture(dataset)?;
    let found: Vec<String> = found.iter().map(|what| format!("{}: {what}", path.display())).collect();
    found.iter().for_each(|warning| eprintln!("warning: {warning}"));
    Ok(found)
}

/// Use of mask files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum MasksArg {
    /// Pixels that are black in the mask are ignored
    #[default]
    Ignore,
    /// Pixels that are white in the mask are ignored
    Inverted,
    /// Masks are not looked at
    Off,
}

/// Meaning of alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum AlphaArg {
    /// The photograph lies over the background
    Composite,
    /// Pixels count in proportion to alpha
    Mask,
}

impl From<AlphaArg> for AlphaMode {
    fn from(alpha: AlphaArg) -> AlphaMode {
        match alpha {
            AlphaArg::Composite => AlphaMode::Composite,
            AlphaArg::Mask => AlphaMode::Mask,
        }
    }
}

/// Views of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SplitArg {
    /// Held-out views
    Test,
    /// Views trained on
    Train,
    /// All views
    All,
}

impl From<SplitArg> for Split {
    fn from(split: SplitArg) -> Split {
        match split {
            SplitArg::Test => Split::Test,
            SplitArg::Train => Split::Train,
            SplitArg::All => Split::All,
        }
    }
}

/// Rasterization rules.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Compat {
    Engine,
    Original,
}

impl From<Compat> for Compatibility {
    fn from(compat: Compat) -> Compatibility {
        match compat {
            Compat::Engine => Compatibility::Engine,
            Compat::Original => Compatibility::Inria,
        }
    }
}
