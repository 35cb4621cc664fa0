//! Photographs of a folder by the labels of other programs, and the files that lie beside a list of cameras.

use super::check::Check;
use super::reader::excerpt;
use super::{ply, reader::Reader};
use crate::error::{Error, Result};
use crate::scene::Point;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Extensions of photographs.
const EXTENSIONS: [&str; 6] = ["jpg", "jpeg", "png", "webp", "tif", "tiff"];

/// Deepest subfolder that is looked into.
const DEPTH_MAX: usize = 8;

/// Bytes from the beginning of a file by which its format is told.
const BEGINNING: usize = 1024;

/// Names of photographs, paths with slashes below their folder, by file name and by file name without extension.
pub(super) struct PhotoIndex {
    names: Vec<String>,
    by_file: BTreeMap<String, Vec<usize>>,
    by_stem: BTreeMap<String, Vec<usize>>,
}

impl PhotoIndex {
    pub(super) fn of(names: impl IntoIterator<Item = String>) -> PhotoIndex {
        let mut index = PhotoIndex {
            names: names.into_iter().collect(),
            by_file: BTreeMap::new(),
            by_stem: BTreeMap::new(),
        };
        for (place, name) in index.names.iter().enumerate() {
            let file = file_name(name);
            index.by_file.entry(file.to_owned()).or_default().push(place);
            index.by_stem.entry(stem(file).to_owned()).or_default().push(place);
        }
        index
    }

    /// The photograph of a label: a file name or a path, with or without extension. Of several that fit, the one whose
    /// path ends the label.
    pub(super) fn find(&self, label: &str) -> Check<Option<&str>> {
        let label = label.replace('\\', "/");
        let file = file_name(&label);
        let found = self
            .by_file
            .get(file)
            .or_else(|| self.by_stem.get(file))
            .or_else(|| self.by_stem.get(stem(file)));
        let names: Vec<&str> = found.into_iter().flatten().map(|&i| self.names[i].as_str()).collect();
        let ends = |name: &&str| {
            let (name, label) = (stem(name), stem(&label));
            label
                .strip_suffix(name)
                .is_some_and(|rest| rest.is_empty() || rest.ends_with('/'))
        };
        match names[..] {
            [] => Ok(None),
            [name] => Ok(Some(name)),
            [first, second, ..] => {
                let mut whole = names.iter().copied().filter(ends);
                match (whole.next(), whole.next()) {
                    (Some(name), None) => Ok(Some(name)),
                    _ => Err(format!(
                        "fits several photographs, {} and {}",
                        excerpt(first),
                        excerpt(second)
                    )),
                }
            }
        }
    }
}

/// The last part of a path with slashes.
pub(super) fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// A name without the extension of its last part.
fn stem(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, extension)) if !stem.is_empty() && !extension.contains('/') => stem,
        _ => name,
    }
}

/// Folder of the photographs of a list of cameras, and its index: `photos` if given or `images` beside the file, with
/// subfolders, else the file's own folder.
pub(super) fn photos_beside(file: &Path, photos: Option<&Path>) -> (PathBuf, PhotoIndex) {
    let own = file.parent().unwrap_or(Path::new(".")).to_owned();
    let images = photos.map_or_else(|| own.join("images"), Path::to_owned);
    let is_apart = photos.is_some() || images.is_dir();
    let (folder, depth) = if is_apart { (images, DEPTH_MAX) } else { (own, 0) };
    let mut names = Vec::new();
    collect(&folder, "", depth, &mut names);
    names.sort();
    (folder, PhotoIndex::of(names))
}

/// Photographs of a folder; one that cannot be read has none.
fn collect(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name();
        let Some(name) = name.to_str().filter(|name| !name.contains(char::is_control)) else {
            continue;
        };
        let extension = Path::new(name).extension().and_then(|e| e.to_str()).unwrap_or_default();
        // Links to folders are not followed: they may lead round in a circle.
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            if depth > 0 {
                collect(&folder.join(name), &format!("{prefix}{name}/"), depth - 1, names);
            }
        } else if EXTENSIONS.contains(&extension.to_ascii_lowercase().as_str()) {
            names.push(format!("{prefix}{name}"));
        }
    }
}

/// Folder of the masks of photographs that lie in `folder`: beside it, or within if they lie beside the file.
pub(super) fn masks_of(file: &Path, folder: &Path) -> PathBuf {
    match file.parent() == Some(folder) {
        true => folder.join("masks"),
        false => folder.parent().unwrap_or(Path::new(".")).join("masks"),
    }
}

/// Mask of a photograph in a folder of masks: COLMAP's NAME.jpg.png, NAME.png or NAME.mask.png.
pub(super) fn mask_in(folder: &Path, name: &str) -> Option<PathBuf> {
    let with = |stem: PathBuf, suffix: &str| {
        let mut name = stem.into_os_string();
        name.push(suffix);
        PathBuf::from(name)
    };
    let whole = folder.join(name);
    let stem = whole.with_extension("");
    let candidates = [with(whole, ".png"), with(stem.clone(), ".png"), with(stem, ".mask.png")];
    candidates.into_iter().find(|path| path.is_file())
}

/// The point cloud beside a list of cameras: NAME.ply of the list's name, else `points.ply`; `None` without one.
pub(super) fn cloud_beside(file: &Path) -> Option<PathBuf> {
    let candidates = [file.with_extension("ply"), file.with_file_name("points.ply")];
    candidates.into_iter().find(|cloud| cloud.is_file())
}

/// Points of the cloud beside a list of cameras, if there is one.
pub(super) fn points_beside(file: &Path) -> Result<Vec<Point>> {
    cloud_beside(file).map_or(Ok(Vec::new()), |cloud| ply::read_points(&cloud))
}

/// The file in a folder with this extension and a beginning that `fits`; `None` without one.
///
/// # Errors
/// Several such files.
pub(super) fn only_file(folder: &Path, extension: &str, fits: fn(&str) -> bool) -> Result<Option<PathBuf>> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let paths = entries.map(|entry| entry.path());
    let is_candidate = |path: &PathBuf| {
        let has_extension = path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
        has_extension && path.is_file() && beginning(path).is_ok_and(|text| fits(&text))
    };
    let mut found: Vec<PathBuf> = paths.filter(is_candidate).collect();
    found.sort();
    match &found[..] {
        [first, second, ..] => {
            let name = |path: &Path| excerpt(&path.file_name().unwrap_or_default().to_string_lossy());
            let what = format!(
                "holds several lists of cameras, {} and {}: name one of them",
                name(first),
                name(second)
            );
            Err(Error::file(folder, what))
        }
        _ => Ok(found.pop()),
    }
}

fn beginning(path: &Path) -> Result<String> {
    let mut reader = Reader::open(path)?;
    let mut bytes = vec![0; BEGINNING.min(usize::try_from(reader.size()).unwrap_or(BEGINNING))];
    reader.fill(&mut bytes, "the beginning")?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_find_photographs_with_and_without_extension() {
        let names = ["a.jpg", "left/b.jpg", "right/b.jpg", "frame.0001.png", "c.png"];
        let index = PhotoIndex::of(names.map(str::to_owned));
        for (label, name) in [
            ("a.jpg", Some("a.jpg")),
            ("a", Some("a.jpg")),
            ("a.tif", Some("a.jpg")),
            (r"C:\photos\left\b.jpg", Some("left/b.jpg")),
            ("/photos/right/b", Some("right/b.jpg")),
            ("frame.0001", Some("frame.0001.png")),
            ("frame.0001.png", Some("frame.0001.png")),
            ("d.jpg", None),
            ("", None),
        ] {
            assert_eq!(index.find(label), Ok(name), "{label}");
        }
        let fault = index.find("b.jpg").err().unwrap_or_default();
        assert!(fault.contains("left/b.jpg") && fault.contains("right/b.jpg"), "{fault}");
    }
}
