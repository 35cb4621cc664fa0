//! Scene files: format by the end of the name.

use super::loaded::{AxesBy, LoadedSplats};
#[cfg(feature = "train")]
use super::sog;
use super::source::Source;
use super::{gltf, ksplat, ply, splat32, spz};
use crate::error::{Error, Result};
use crate::scene::{Axes, Primitive, ScreenFilter, Splats};
use std::path::Path;

type Reader = fn(Source<'_>) -> Result<LoadedSplats>;
type Writer = fn(&Path, &Splats) -> Result<()>;

/// A file format of scenes.
struct SceneFormat {
    name: &'static str,
    /// Ends of file names by which it is recognised, in lower case.
    ends: &'static [&'static str],
    read: Reader,
    write: Option<Writer>,
    /// Whether there is a place for surfels.
    holds_surfels: bool,
    /// Whether there is a place for the filter on the screen.
    holds_filter: bool,
    /// Whether there is a place for the origin.
    holds_origin: bool,
    /// Highest SH degree.
    sh_degree: u32,
}

/// All formats; the first one of a fitting end counts.
const FORMATS: &[SceneFormat] = &[
    SceneFormat {
        name: "compressed PLY",
        ends: &[".compressed.ply"],
        read: |s| ply::read(s),
        write: Some(ply::compressed::write),
        holds_surfels: false,
        holds_filter: true,
        holds_origin: true,
        sh_degree: 3,
    },
    SceneFormat {
        name: "PLY",
        ends: &[".ply"],
        read: |s| ply::read(s),
        write: Some(ply::write),
        holds_surfels: true,
        holds_filter: true,
        holds_origin: true,
        sh_degree: 3,
    },
    SceneFormat {
        name: "splat",
        ends: &[".splat"],
        read: |s| splat32::read(s),
        write: Some(splat32::write),
        holds_surfels: false,
        holds_filter: false,
        holds_origin: false,
        sh_degree: 0,
    },
    SceneFormat {
        name: "SPZ",
        ends: &[".spz"],
        read: |s| spz::read(s),
        write: Some(spz::write),
        holds_surfels: false,
        holds_filter: true,
        holds_origin: false,
        sh_degree: 3,
    },
    #[cfg(feature = "train")]
    SceneFormat {
        name: "SOG",
        ends: &[".sog"],
        read: |s| sog::read(s),
        write: Some(sog::write),
        holds_surfels: false,
        holds_filter: true,
        holds_origin: false,
        sh_degree: 3,
    },
    #[cfg(feature = "train")]
    SceneFormat {
        name: "SOG",
        ends: &["meta.json"],
        read: |s| sog::read(s),
        write: None,
        holds_surfels: false,
        holds_filter: true,
        holds_origin: false,
        sh_degree: 3,
    },
    SceneFormat {
        name: "glTF",
        ends: &[".glb"],
        read: |s| gltf::read(s),
        write: Some(gltf::write),
        holds_surfels: false,
        holds_filter: false,
        holds_origin: true,
        sh_degree: 3,
    },
    SceneFormat {
        name: "glTF",
        ends: &[".gltf"],
        read: |s| gltf::read(s),
        write: None,
        holds_surfels: false,
        holds_filter: false,
        holds_origin: true,
        sh_degree: 3,
    },
    SceneFormat {
        name: "KSPLAT",
        ends: &[".ksplat"],
        read: |s| ksplat::read(s),
        write: None,
        holds_surfels: false,
        holds_filter: false,
        holds_origin: false,
        sh_degree: 2,
    },
];

fn format_of(path: &Path) -> Option<&'static SceneFormat> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let fits = |format: &&SceneFormat| format.ends.iter().any(|end| name.ends_with(end));
    FORMATS.iter().find(fits)
}

fn endings(is_in: impl Fn(&SceneFormat) -> bool) -> String {
    let formats = FORMATS.iter().filter(|format| is_in(format));
    let endings: Vec<&str> = formats.flat_map(|format| format.ends).copied().collect();
    endings.join(" or ")
}

/// Ends of the names of files that [`read()`] reads.
pub fn readable() -> String {
    endings(|_| true)
}

/// Ends of the names of files that [`write()`] writes.
pub fn writable() -> String {
    endings(|format| format.write.is_some())
}

/// Reads a scene, in the format that the end of its name says, and turns it to the axes of this engine.
///
/// # Errors
/// Those of the format's reader; a name of no known end.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    read_in_axes(source, None)
}

/// As [`read()`], with `axes` in place of those that the format or the file states.
///
/// # Errors
/// Those of [`read()`].
pub fn read_in_axes<'a>(source: impl Into<Source<'a>>, axes: Option<Axes>) -> Result<LoadedSplats> {
    let source = source.into();
    let Some(format) = format_of(source.name()) else {
        let what = format!("the name does not end in {}, as scenes that can be read do", readable());
        return Err(Error::file(source.name(), what));
    };
    let mut loaded = (format.read)(source)?;
    if let Some(axes) = axes {
        (loaded.stored.axes, loaded.stored.axes_by) = (axes, AxesBy::Choice);
    }
    loaded.splats.change_axes(loaded.stored.axes, Axes::RDF);
    Ok(loaded)
}

/// Writes a scene, in the format that the end of its name says, atomically. Surfels in a format without a place for
/// them become 3D Gaussians of their thickness.
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    let write = writer(path)?;
    match holds_surfels(path) || splats.primitive != Primitive::Surfel {
        true => write(path, splats),
        false => write(path, &splats.clone().into_3d()),
    }
}

/// Whether files of this name have a place for surfels.
pub fn holds_surfels(path: &Path) -> bool {
    format_of(path).is_some_and(|format| format.holds_surfels)
}

/// Refuses names that [`write()`] refuses, before there is anything to write.
pub fn check_name(path: &Path) -> Result<()> {
    writer(path).map(|_| ())
}

/// Properties of a scene that a file of this name cannot hold, a sentence each.
pub fn losses(path: &Path, splats: &Splats) -> Vec<String> {
    let Some(format) = format_of(path) else {
        return Vec::new();
    };
    let name = format.name;
    let mut losses = Vec::new();
    if !format.holds_surfels && splats.primitive == Primitive::Surfel {
        losses.push(format!(
            "{name} files have no place for surfels: they become 3D Gaussians of a hundredth of their smaller scale"
        ));
    }
    if !format.holds_filter && splats.filter != ScreenFilter::default() {
        let filter = splats.filter.name();
        losses.push(format!("{name} files have no place for the render mode \"{filter}\""));
    }
    if !format.holds_origin && splats.origin != Default::default() {
        losses.push(format!(
            "{name} files have no place for the origin {}; positions are relative to it",
            splats.origin
        ));
    }
    if format.sh_degree < splats.sh_degree {
        losses.push(format!(
            "{name} files have no harmonics above degree {}; those to degree {} are left out",
            format.sh_degree, splats.sh_degree
        ));
    }
    losses
}

fn writer(path: &Path) -> Result<Writer> {
    let write = format_of(path).and_then(|format| format.write);
    write.ok_or_else(|| {
        Error::file(
            path,
            format!("scenes are written to {} files; choose such a name", writable()),
        )
    })
}
