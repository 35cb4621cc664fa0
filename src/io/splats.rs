//! Scene files: format by the end of the name.

use super::ply::{self, LoadedSplats};
use super::source::Source;
use super::splat32;
use crate::error::{Error, Result};
use crate::scene::Splats;
use std::path::Path;

type Reader = fn(Source<'_>) -> Result<LoadedSplats>;
type Writer = fn(&Path, &Splats) -> Result<()>;

/// A file format of scenes: name, ends of file names by which it is recognised, reader and writer.
struct Format(&'static str, &'static [&'static str], Option<Reader>, Option<Writer>);

/// All formats; unsupported ones for the advice to convert.
const FORMATS: [Format; 5] = [
    Format("PLY", &[".ply"], Some(|s| ply::read(s)), Some(ply::write)),
    Format("splat", &[".splat"], Some(|s| splat32::read(s)), None),
    Format("SPZ", &[".spz"], None, None),
    Format("SOG", &[".sog", "meta.json"], None, None),
    Format("KSPLAT", &[".ksplat"], None, None),
];

fn format_of(path: &Path) -> Option<&'static Format> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let ends = |Format(_, ends, ..): &&Format| ends.iter().any(|end| name.ends_with(end));
    FORMATS.iter().find(ends)
}

fn endings(is_in: impl Fn(&Format) -> bool) -> String {
    let formats = FORMATS.iter().filter(|format| is_in(format));
    let endings: Vec<&str> = formats.flat_map(|format| format.1).copied().collect();
    endings.join(" or ")
}

/// Ends of the names of files that [`read()`] reads.
pub fn readable() -> String {
    endings(|format| format.2.is_some())
}

/// Ends of the names of files that [`write()`] writes.
pub fn writable() -> String {
    endings(|format| format.3.is_some())
}

/// Reads a scene, in the format that the end of its name says.
///
/// # Errors
/// Those of the format's reader; for unsupported splat formats, the advice to convert.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let fault = match format_of(source.name()) {
        Some(Format(_, _, Some(read), _)) => return read(source),
        Some(Format(name, ..)) => {
            format!("{name} scenes are not supported; convert to a {}", writable())
        }
        None => format!("the name does not end in {}, as scenes that can be read do", readable()),
    };
    Err(Error::file(source.name(), fault))
}

/// Writes a scene, in the format that the end of its name says, atomically.
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    writer(path)?(path, splats)
}

/// Refuses names that [`write()`] refuses, before there is anything to write.
pub fn check_name(path: &Path) -> Result<()> {
    writer(path).map(|_| ())
}

fn writer(path: &Path) -> Result<Writer> {
    let write = format_of(path).and_then(|format| format.3);
    write.ok_or_else(|| {
        let read_only = endings(|format| format.2.is_some() && format.3.is_none());
        let fault = format!(
            "scenes are written to {} files only, {read_only} is for reading; choose such a name",
            writable()
        );
        Error::file(path, fault)
    })
}
