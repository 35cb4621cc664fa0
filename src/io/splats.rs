//! Scene files: format by the extension of the name.

use super::ply::{self, LoadedSplats};
use super::source::Source;
use super::splat32;
use crate::error::{Error, Result};
use crate::scene::Splats;
use std::path::Path;

/// Reads a scene from a `.ply` or `.splat` file, by the extension of its name.
///
/// # Errors
/// Those of the format's reader; for unsupported splat formats, the advice to convert.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let path = source.name();
    let extension = extension(path);
    match extension.as_str() {
        "ply" => ply::read(source),
        "splat" => splat32::read(source),
        "spz" | "sog" | "ksplat" => Err(Error::file(
            path,
            format!(".{extension} scenes are not supported; convert to a .ply"),
        )),
        "json" if path.file_name().is_some_and(|name| name == "meta.json") => Err(Error::file(
            path,
            "SOG scenes are not supported; convert to a .ply",
        )),
        _ => Err(Error::file(
            path,
            "the name does not end in .ply or .splat, the formats of splats that can be read",
        )),
    }
}

/// Writes a scene to a `.ply` file, atomically.
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    check_name(path)?;
    ply::write(path, splats)
}

/// Refuses names that [`write()`] refuses, before there is anything to write.
pub fn check_name(path: &Path) -> Result<()> {
    match extension(path).as_str() {
        "ply" => Ok(()),
        _ => Err(Error::file(
            path,
            "splats are written to .ply files only; choose such a name",
        )),
    }
}

fn extension(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default()
}
