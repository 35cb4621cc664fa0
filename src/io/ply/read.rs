//! Reading splats and points.

use super::super::loaded::{Collector, LoadedSplats, StoredAs, StoredSplat};
use super::super::reader::{Reader, excerpt};
use super::super::source::Source;
use super::comments::{origin, render_mode, up};
use super::compressed;
use super::header::{Encoding, PlyElement, PlyHeader};
use super::rows;
use crate::error::{Error, Result};
use crate::scene::{Point, Primitive, Splats, sh_coefficient_count};
use std::path::Path;

/// Property that surfels lack.
const THIRD_SCALE: &str = "scale_2";

/// Required properties, in the order of the values of a row.
const REQUIRED: [&str; 14] = [
    "x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity", "f_dc_0", "f_dc_1",
    "f_dc_2",
];

/// Reads a scene of splats: surfels if the file has no `scale_2`, as those of the 2DGS reference code, if a comment
/// says so, or if none does and all third scales are that of nothing.
///
/// # Errors
/// Names the file and the place: not a PLY file, not splats (the missing properties are listed), counts beyond the
/// file, or a row that cannot be parsed.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let path = source.name();
    let mut reader = Reader::open(source)?;
    let header = PlyHeader::read(&mut reader)?;
    if header.element("chunk").is_some() {
        let mut warnings = Vec::new();
        let (primitive, filter) = render_mode(path, &header.comments, &mut warnings);
        let scene = Splats {
            primitive: primitive.unwrap_or_default(),
            filter,
            origin: origin(path, &header.comments)?,
            up: up(path, &header.comments)?,
            ..Splats::default()
        };
        return compressed::read(reader, &header, scene, warnings);
    }
    let Some((index, vertex)) = header.element("vertex") else {
        return Err(Error::file(path, "has no element \"vertex\""));
    };
    let (columns, sh_degree) = splat_columns(path, vertex)?;
    let mut warnings = Vec::new();
    let (mut stated, filter) = render_mode(path, &header.comments, &mut warnings);
    if vertex.find(THIRD_SCALE).is_none() {
        // Structure outranks comments.
        stated = Some(Primitive::Surfel);
    }
    let origin = origin(path, &header.comments)?;
    let up = up(path, &header.comments)?;
    rows::skip_to(&mut reader, &header, index)?;
    let count = rows::check_count(&reader, header.encoding, vertex)?;
    let mut collector = Collector::new(count, sh_degree, filter);
    let mut sh = vec![0.0; sh_coefficient_count(sh_degree) * 3];
    rows::read(&mut reader, header.encoding, vertex, &columns, |row| {
        collector.push(&splat(row, &mut sh));
    })?;
    if index + 1 == header.elements.len() {
        warn_of_trailing_bytes(path, &mut reader, header.encoding, &mut warnings)?;
    }
    let mut loaded = collector.finish(path, StoredAs::ply("PLY"), warnings);
    loaded.splats.origin = origin;
    loaded.splats.up = up;
    loaded.splats.primitive = stated.unwrap_or_default();
    if stated.is_none() && is_flat(&loaded.splats) {
        loaded.splats.primitive = Primitive::Surfel;
        loaded.warnings.push(format!(
            "{}: the third scales of all splats are below 1e-5 of the others: read as 2D Gaussians (surfels)",
            path.display()
        ));
    }
    loaded.splats.set_thickness();
    Ok(loaded)
}

/// Difference of log-scales, e⁻¹² = 6e-6, by which a third scale is that of a flat splat: programs for 3D Gaussians
/// write such scales for surfels.
const FLAT: f32 = 12.0;

/// Whether all splats are flat along their third axes.
fn is_flat(splats: &Splats) -> bool {
    // Scales beyond floats are no sizes to compare with.
    let is_flat = |&[u, v, third]: &[f32; 3]| u.max(v).exp().is_finite() && third <= u.max(v) - FLAT;
    !splats.is_empty() && splats.log_scale.iter().all(is_flat)
}

/// Splat of a row in the order of [`splat_columns`]. Doubles beyond the range of `f32` become infinite.
fn splat<'a>(row: &[f64], sh: &'a mut [f32]) -> StoredSplat<'a> {
    let value = |i: usize| row[i] as f32;
    // The file has all coefficients of red, then of green, then of blue.
    let rest = sh.len() / 3 - 1;
    for channel in 0..3 {
        sh[channel] = value(11 + channel);
        for coefficient in 0..rest {
            sh[3 * (1 + coefficient) + channel] = value(14 + channel * rest + coefficient);
        }
    }
    StoredSplat {
        mean: [value(0), value(1), value(2)],
        quaternion: [value(3), value(4), value(5), value(6)],
        log_scale: [value(7), value(8), value(9)],
        opacity_logit: value(10),
        sh,
    }
}

/// Columns of x, y, z and, if present, red, green, blue; and the factor of the colours, of which 255 is the largest as
/// an integer and 1 as a float.
pub(super) fn colored_vertex_columns(path: &Path, vertex: &PlyElement) -> Result<(Vec<usize>, Option<f64>)> {
    let find = |names: [&str; 3]| -> Option<Vec<usize>> { names.into_iter().map(|name| vertex.find(name)).collect() };
    let Some(mut columns) = find(["x", "y", "z"]) else {
        return Err(Error::file(path, "the vertices have no x, y, z"));
    };
    let mut unit = None;
    if let Some(colors) = find(["red", "green", "blue"]) {
        let whole = vertex.properties[colors[0]].scalar.bytes() < 4;
        unit = Some(if whole { 1.0 / 255.0 } else { 1.0 });
        columns.extend(colors);
    }
    Ok((columns, unit))
}

/// Reads a point cloud: `x y z` and, if present, `red green blue` (0 to 255 as integers, 0 to 1 as floats), else grey.
/// Points that are not finite are kept for the caller to count.
pub fn read_points<'a>(source: impl Into<Source<'a>>) -> Result<Vec<Point>> {
    let source = source.into();
    let path = source.name();
    let mut reader = Reader::open(source)?;
    let header = PlyHeader::read(&mut reader)?;
    let Some((index, vertex)) = header.element("vertex") else {
        return Err(Error::file(path, "has no element \"vertex\""));
    };
    refuse_lists(path, vertex)?;
    let (columns, unit) = colored_vertex_columns(path, vertex)?;
    rows::skip_to(&mut reader, &header, index)?;
    let count = rows::check_count(&reader, header.encoding, vertex)?;
    let mut points = Vec::with_capacity(count);
    rows::read(&mut reader, header.encoding, vertex, &columns, |row| {
        let color = |channel: usize| unit.map_or(0.5, |unit| (row[3 + channel] * unit) as f32);
        points.push(Point {
            position: [row[0], row[1], row[2]],
            color: [color(0), color(1), color(2)],
        });
    })?;
    Ok(points)
}

fn refuse_lists(path: &Path, vertex: &PlyElement) -> Result<()> {
    match vertex.properties.iter().find(|p| p.list.is_some()) {
        Some(list) => Err(Error::file(
            path,
            format!("the vertex property {} is a list", excerpt(&list.name)),
        )),
        None => Ok(()),
    }
}

/// Column of each value of a splat, in the order of [`REQUIRED`] and then of `f_rest`; and the SH degree.
fn splat_columns(path: &Path, vertex: &PlyElement) -> Result<(Vec<usize>, u32)> {
    let mut missing: Vec<&str> = REQUIRED
        .into_iter()
        .filter(|name| vertex.find(name).is_none())
        .collect();
    let is_surfel = missing == [THIRD_SCALE];
    if is_surfel {
        missing.clear();
    }
    if missing.len() > REQUIRED.len() / 2 {
        let what = "holds no splats (a point cloud or a mesh?): f_dc_0, opacity, scale_0, rot_0 \
                    and others are missing";
        return Err(Error::file(path, what));
    }
    if !missing.is_empty() {
        return Err(Error::file(
            path,
            format!("the vertex properties {} are missing", missing.join(", ")),
        ));
    }
    refuse_lists(path, vertex)?;
    let rest = vertex
        .properties
        .iter()
        .filter(|p| p.name.starts_with("f_rest_"))
        .count();
    let degree = (0..=3u32)
        .find(|&degree| (sh_coefficient_count(degree) - 1) * 3 == rest)
        .ok_or_else(|| {
            let what = format!("{rest} f_rest properties; 0, 9, 24 or 45 are possible");
            Error::file(path, what)
        })?;
    let names = REQUIRED.into_iter().map(str::to_owned);
    let names = names.chain((0..rest).map(|i| format!("f_rest_{i}")));
    // A placeholder in place of the third scale that surfels do not have.
    let column = |name: String| {
        vertex.find(if is_surfel && name == THIRD_SCALE {
            "scale_1"
        } else {
            &name
        })
    };
    let columns: Option<Vec<usize>> = names.map(column).collect();
    let columns = columns.ok_or_else(|| {
        let what = format!("the f_rest properties are not numbered 0 to {}", rest - 1);
        Error::file(path, what)
    })?;
    Ok((columns, degree))
}

fn warn_of_trailing_bytes(
    path: &Path,
    reader: &mut Reader,
    encoding: Encoding,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let mut left = reader.remaining();
    // Blank lines at the end of a text file are allowed.
    if encoding == Encoding::Ascii && left > 0 && left <= 64 {
        let mut tail = vec![0; left as usize];
        reader.fill(&mut tail, "the end")?;
        left = tail.trim_ascii().len() as u64;
    }
    if left > 0 {
        warnings.push(format!(
            "{}: {left} bytes after the last vertex were ignored",
            path.display()
        ));
    }
    Ok(())
}
