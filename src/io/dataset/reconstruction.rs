//! Reconstruction of a data set: its format and its files.

use super::super::listing::{ListedView, Listing};
use super::super::{colmap, metashape, realitycapture, transforms};
use super::OpenOptions;
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};

/// Format of a reconstruction, and its file or folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reconstruction {
    /// Folder of a COLMAP model.
    Colmap(PathBuf),
    /// A `transforms.json`.
    Transforms(PathBuf),
    /// RealityCapture's table of cameras.
    RealityCapture(PathBuf),
    /// Metashape's list of cameras.
    Metashape(PathBuf),
}

impl Reconstruction {
    /// Whether a file's extension is that of a reconstruction.
    pub fn is_file(path: &Path) -> bool {
        path.is_file() && Reconstruction::of_file(path).is_some()
    }

    /// That of a file, by its extension.
    fn of_file(path: &Path) -> Option<Reconstruction> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        let format = match extension.as_str() {
            "json" => Reconstruction::Transforms,
            "csv" => Reconstruction::RealityCapture,
            "xml" => Reconstruction::Metashape,
            _ => return None,
        };
        Some(format(path.to_owned()))
    }

    /// That of a file or of a folder: a COLMAP model comes first, then a `transforms.json`, a table of
    /// RealityCapture's, a list of Metashape's. `None` without one.
    ///
    /// # Errors
    /// A folder with several tables or lists, and none that comes before them.
    pub fn find(path: &Path) -> Result<Option<Reconstruction>> {
        if path.is_file() {
            return Ok(Reconstruction::of_file(path));
        }
        if let Some(model) = colmap::find_model(path) {
            return Ok(Some(Reconstruction::Colmap(model)));
        }
        if let Some(file) = transforms::find(path) {
            return Ok(Some(Reconstruction::Transforms(file)));
        }
        if let Some(file) = realitycapture::find(path)? {
            return Ok(Some(Reconstruction::RealityCapture(file)));
        }
        Ok(metashape::find(path)?.map(Reconstruction::Metashape))
    }
}

/// Detects the format and reads it.
pub(super) fn list(path: &Path, options: &OpenOptions) -> Result<Listing> {
    let meta = std::fs::metadata(path).map_err(Error::io(path))?;
    let photos = options.images.as_ref().map(|images| photo_folder(path, images));
    match Reconstruction::find(path)? {
        Some(Reconstruction::Colmap(model)) => {
            let photos = photos.unwrap_or_else(|| photo_folder(path, Path::new("images")));
            colmap::read(&model, &photos)
        }
        Some(Reconstruction::Transforms(file)) if meta.is_file() => transforms::read(&file, photos.as_deref()),
        Some(Reconstruction::Transforms(file)) => transforms_with_test(path, &file, photos.as_deref(), options),
        Some(Reconstruction::RealityCapture(file)) => realitycapture::read(&file, photos.as_deref()),
        Some(Reconstruction::Metashape(file)) => metashape::read(&file, photos.as_deref()),
        None => Err(Error::file(path, no_data_set(path, meta.is_file()))),
    }
}

fn no_data_set(path: &Path, is_file: bool) -> String {
    if is_file {
        return "is no data set: a folder, a transforms.json, a .csv of RealityCapture or an .xml of Metashape is expected"
            .to_owned();
    }
    let hint = if path.join("sparse").is_file() {
        " (sparse is a file, not a folder)"
    } else {
        ""
    };
    format!(
        "is no data set: none of sparse/0/cameras.bin, sparse/cameras.bin, cameras.bin (or .txt), transforms.json, \
         transforms_train.json, a .csv of RealityCapture's cameras and an .xml of Metashape's is there{hint}"
    )
}

/// Reads a `transforms.json`. Blender's test views are in a second file, read only beside `transforms_train.json`.
fn transforms_with_test(path: &Path, file: &Path, photos: Option<&Path>, options: &OpenOptions) -> Result<Listing> {
    let mut listing = transforms::read(file, photos)?;
    let test = path.join("transforms_test.json");
    let split = file.ends_with("transforms_train.json");
    if split && test.is_file() && options.test_every > 0 {
        let held_out = transforms::read(&test, photos)?;
        listing.warnings.extend(held_out.warnings);
        let views = held_out.views.into_iter();
        listing
            .views
            .extend(views.map(|view| ListedView { held_out: true, ..view }));
    }
    Ok(listing)
}

/// Folder of photographs by its name in the data set at `path`, a file or a folder: beside a file; one or two folders
/// above a COLMAP model that has none. An absolute name is the folder itself.
pub fn photo_folder(path: &Path, name: &Path) -> PathBuf {
    if path.is_file() {
        return path.parent().unwrap_or(Path::new(".")).join(name);
    }
    let own = path.join(name);
    let above = [path.join("..").join(name), path.join("../..").join(name)];
    let is_model = path.join("cameras.bin").is_file() || path.join("cameras.txt").is_file();
    if is_model
        && !own.is_dir()
        && let Some(found) = above.into_iter().find(|folder| folder.is_dir())
    {
        return found;
    }
    own
}
