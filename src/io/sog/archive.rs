//! Files of a scene by name: entries of a ZIP archive, or files beside `meta.json`.

use super::super::check::{Check, inside};
use super::super::reader::{Reader, excerpt};
use super::super::source::Source;
use crate::error::{Error, Result};
use std::borrow::Cow;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// Name of the list of attributes.
pub(super) const META: &str = "meta.json";

/// Name of the list of a streamed scene, which is a tree of such scenes.
pub(super) const META_STREAMED: &str = "lod-meta.json";

/// Largest `meta.json` in bytes; splat-transform's have 16 KiB.
pub(super) const META_BYTES_MAX: u64 = 1 << 20;

/// Most entries of an archive; a scene has eight.
const ENTRIES_MAX: usize = 1000;

/// The scene's files.
pub(super) struct SogContainer<'a> {
    /// Path of the bundle or of `meta.json`.
    path: &'a Path,
    place: Place<'a>,
}

enum Place<'a> {
    Bundle {
        archive: ZipArchive<Cursor<Cow<'a, [u8]>>>,
        /// Leading folder with its slash, or nothing.
        folder: String,
        bytes: u64,
    },
    Folder(PathBuf),
}

impl<'a> SogContainer<'a> {
    /// Opens a bundle, or the folder of a `meta.json`; returns its contents as well.
    pub(super) fn open(source: Source<'a>) -> Result<(SogContainer<'a>, Vec<u8>)> {
        let path = source.name();
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        if name.ends_with(META_STREAMED) {
            return Err(Error::file(path, STREAMED));
        }
        let bytes = Reader::all(source)?;
        if name.ends_with(META) {
            if bytes.len() as u64 > META_BYTES_MAX {
                return Err(Error::file(path, too_long(bytes.len() as u64, META_BYTES_MAX)));
            }
            let folder = path.parent().unwrap_or(Path::new(".")).to_path_buf();
            let place = Place::Folder(folder);
            return Ok((SogContainer { path, place }, bytes.into()));
        }
        let length = bytes.len() as u64;
        let archive = ZipArchive::new(Cursor::new(bytes))
            .map_err(|e| Error::file(path, format!("is no complete ZIP archive: {e}")))?;
        let folder = folder_of(&archive, path).map_err(|what| Error::file(path, what))?;
        let place = Place::Bundle {
            archive,
            folder,
            bytes: length,
        };
        let mut container = SogContainer { path, place };
        let meta = container.read(META, META_BYTES_MAX)?;
        Ok((container, meta))
    }

    /// Error about a file of the scene.
    pub(super) fn fault(&self, name: &str, what: impl AsRef<str>) -> Error {
        let what = what.as_ref();
        match &self.place {
            Place::Folder(folder) if name != META => Error::file(folder.join(name), what),
            Place::Folder(_) => Error::file(self.path, what),
            Place::Bundle { .. } => Error::file(self.path, format!("{}: {what}", tame(name))),
        }
    }

    /// Refuses names that lead out of the scene.
    pub(super) fn check_name(&self, name: &str) -> Result<()> {
        let place = match &self.place {
            Place::Bundle { .. } => self.path,
            Place::Folder(folder) => folder,
        };
        inside(place, name).map(|_| ()).map_err(|what| self.fault(META, what))
    }

    /// Length in bytes of the bundle, or of these files of the folder together.
    pub(super) fn bytes(&self, names: &[&str]) -> Result<u64> {
        match &self.place {
            Place::Bundle { bytes, .. } => Ok(*bytes),
            Place::Folder(folder) => names.iter().try_fold(0, |sum, name| {
                let path = folder.join(name);
                let meta = std::fs::metadata(&path).map_err(Error::io(&path))?;
                Ok(sum + meta.len())
            }),
        }
    }

    /// Contents of a file of at most `limit` bytes; the name has been checked.
    pub(super) fn read(&mut self, name: &str, limit: u64) -> Result<Vec<u8>> {
        let mut contents = Vec::new();
        let length = match &mut self.place {
            Place::Folder(folder) => {
                contents = Reader::all(Source::from(&folder.join(name)))?.into();
                contents.len() as u64
            }
            Place::Bundle { archive, folder, .. } => {
                let index = archive.index_for_name(&format!("{folder}{name}"));
                let index = index.ok_or_else(|| Error::file(self.path, absent(name)))?;
                let said = |e: &dyn std::fmt::Display| {
                    Error::file(self.path, format!("{}: cannot be unpacked: {e}", tame(name)))
                };
                let entry = archive.by_index(index).map_err(|e| said(&e))?;
                let length = entry.size();
                if length <= limit {
                    entry.take(limit + 1).read_to_end(&mut contents).map_err(|e| said(&e))?;
                }
                length.max(contents.len() as u64)
            }
        };
        match length <= limit {
            true => Ok(contents),
            false => Err(self.fault(name, too_long(length, limit))),
        }
    }
}

const STREAMED: &str = "is the list of a streamed SOG scene with levels of detail, which is not supported; read the \
                        meta.json of one level";

/// At most 60 characters of a name.
fn tame(name: &str) -> String {
    excerpt(name).replace('"', "")
}

fn too_long(bytes: u64, limit: u64) -> String {
    format!("has {bytes} bytes, more than the {limit} that such a file needs at most")
}

fn absent(name: &str) -> String {
    format!("the archive has no {}", excerpt(name))
}

/// Folder of `meta.json` inside an archive, with its slash; or the fault of the archive's names.
fn folder_of<R: Read + std::io::Seek>(archive: &ZipArchive<R>, path: &Path) -> Check<String> {
    if archive.has_duplicate_names() {
        return Err("two entries of the archive have the same name".into());
    }
    if archive.len() > ENTRIES_MAX {
        let count = archive.len();
        return Err(format!("the archive has {count} entries; {ENTRIES_MAX} are the limit"));
    }
    let mut folders = Vec::new();
    let mut is_streamed = false;
    for name in archive.file_names() {
        let name = name.map_err(|e| format!("a name in the archive cannot be read: {e}"))?;
        inside(path, &name)?;
        let (folder, last) = name.rsplit_once('/').unwrap_or(("", &name));
        is_streamed |= last == META_STREAMED;
        if last == META && !folder.contains('/') {
            folders.push(folder.to_owned());
        }
    }
    if folders.iter().any(String::is_empty) {
        return Ok(String::new());
    }
    match folders.as_slice() {
        [folder] => Ok(format!("{folder}/")),
        [] if is_streamed => Err(STREAMED.into()),
        [] => Err(absent(META)),
        _ => Err(format!("the archive has {} files {META}", folders.len())),
    }
}
