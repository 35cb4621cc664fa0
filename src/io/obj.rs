//! Wavefront `.obj` meshes, and points on them to begin a scene from.
//!
//! Positions, vertex colours and faces are read; materials, normals, texture coordinates and groups are
//! skipped. The format is read here and not by a library because every index must be held against
//! the vertices, with its line in the message, before any arithmetic is done on it.

use super::reader::{Reader, excerpt};
use crate::error::{Error, Result};
use crate::scene::{Mesh, Point};
use glam::Vec3;
use std::path::Path;

/// Lines beyond this length are refused.
const LINE_BYTES_MAX: u64 = 1 << 24;

/// Reads a mesh; polygons become fans of triangles.
///
/// # Errors
/// Names the line: a coordinate that is missing or not finite, an index of no vertex, a face with less
/// than three corners. A mesh without faces is an error as well.
pub fn read(path: &Path) -> Result<Mesh> {
    let mut reader = Reader::open(path)?;
    let mut mesh = Mesh::default();
    let mut colored = 0;
    let mut line = String::new();
    let mut forward = Highest::default();
    while reader.line(&mut line, LINE_BYTES_MAX)? {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => colored += usize::from(read_vertex(&reader, words, &mut mesh)?),
            Some("f") => read_face(&reader, words, &mut mesh, &mut forward)?,
            _ => {}
        }
    }
    // Faces may stand before their vertices; then this is where the index is known to be wrong.
    if forward.index as usize >= mesh.positions.len() && !mesh.triangles.is_empty() {
        let what = format!(
            "line {}: vertex {} does not exist, there are {}",
            forward.line,
            u64::from(forward.index) + 1,
            mesh.positions.len()
        );
        return Err(Error::file(path, what));
    }
    if mesh.triangles.is_empty() {
        return Err(Error::file(path, "holds no faces"));
    }
    if colored < mesh.positions.len() {
        mesh.colors.clear();
    }
    Ok(mesh)
}

/// The highest vertex index used, and where.
#[derive(Default)]
struct Highest {
    index: u32,
    line: u64,
}

/// Reads `x y z` and, if they follow, `r g b`; says whether they did.
fn read_vertex<'a>(
    reader: &Reader,
    words: impl Iterator<Item = &'a str>,
    mesh: &mut Mesh,
) -> Result<bool> {
    let mut values = Vec::with_capacity(7);
    for word in words.take(7) {
        let value: f32 = word
            .parse()
            .ok()
            .filter(|v: &f32| v.is_finite())
            .ok_or_else(|| {
                let what = format!("the coordinate {} is no finite number", excerpt(word));
                reader.fault_in_line(what)
            })?;
        values.push(value);
    }
    let [x, y, z, rest @ ..] = &values[..] else {
        return Err(reader.fault_in_line("a vertex needs three coordinates"));
    };
    if mesh.positions.len() >= u32::MAX as usize {
        return Err(reader.fault_in_line("more vertices than 32-bit indices can name"));
    }
    mesh.positions.push([*x, *y, *z]);
    // Three further numbers are a colour; one is the weight of a rational curve.
    if let [r, g, b, ..] = rest {
        mesh.colors.push([*r, *g, *b].map(|c| c.clamp(0.0, 1.0)));
        return Ok(true);
    }
    Ok(false)
}

fn read_face<'a>(
    reader: &Reader,
    words: impl Iterator<Item = &'a str>,
    mesh: &mut Mesh,
    highest: &mut Highest,
) -> Result<()> {
    let mut corners = Vec::with_capacity(4);
    for word in words {
        let index = word.split('/').next().unwrap_or_default();
        let known = mesh.positions.len() as i64;
        let vertex = match index.parse::<i64>() {
            Ok(i) if i > 0 => Some(i - 1),
            // Negative indices count back from the vertex read last.
            Ok(i) if i < 0 => known.checked_add(i).filter(|v| *v >= 0),
            _ => None,
        };
        let vertex = vertex.and_then(|v| u32::try_from(v).ok()).ok_or_else(|| {
            let what = format!("{} names no vertex; {known} are known here", excerpt(word));
            reader.fault_in_line(what)
        })?;
        if vertex >= highest.index {
            (highest.index, highest.line) = (vertex, reader.line_number());
        }
        corners.push(vertex);
    }
    let [first, rest @ ..] = &corners[..] else {
        return Err(reader.fault_in_line("a face without corners"));
    };
    if rest.len() < 2 {
        return Err(reader.fault_in_line("a face needs three corners"));
    }
    let fan = rest.windows(2).map(|pair| [*first, pair[0], pair[1]]);
    mesh.triangles.extend(fan);
    Ok(())
}

/// The vertices as points, grey where the mesh has no colours.
pub fn vertices(mesh: &Mesh) -> Vec<Point> {
    let grey = [0.5; 3];
    let points = mesh.positions.iter().enumerate();
    points
        .map(|(i, position)| Point {
            position: *position,
            color: mesh.colors.get(i).copied().unwrap_or(grey),
        })
        .collect()
}

/// `count` points on the surface, evenly by area; the same seed gives the same points. A mesh without
/// area gives none.
pub fn sample(mesh: &Mesh, count: usize, seed: u64) -> Vec<Point> {
    let mut area_until = Vec::with_capacity(mesh.triangles.len());
    let mut area = 0.0;
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i).map(|p| Vec3::from(p).as_dvec3());
        area += 0.5 * (b - a).cross(c - a).length();
        area_until.push(area);
    }
    if area.is_nan() || area <= 0.0 {
        return Vec::new();
    }
    let mut state = seed;
    let mut random = || uniform(&mut state);
    (0..count)
        .map(|_| {
            let at = random() * area;
            // Rounding can put `at` on the total; the last triangle takes it.
            let index = area_until.partition_point(|until| *until <= at);
            let index = index.min(mesh.triangles.len() - 1);
            // Turk, "Generating random points in triangles", Graphics Gems I.
            let (root, v) = (random().sqrt() as f32, random() as f32);
            let weights = [1.0 - root, root * (1.0 - v), root * v];
            let blend = |corners: [[f32; 3]; 3]| -> [f32; 3] {
                let sum = |axis: usize| (0..3).map(|k| weights[k] * corners[k][axis]).sum();
                [sum(0), sum(1), sum(2)]
            };
            let colors = mesh.triangles[index].map(|v| mesh.colors.get(v as usize).copied());
            Point {
                position: blend(mesh.corners(index)),
                color: blend(colors.map(|c| c.unwrap_or([0.5; 3]))),
            }
        })
        .collect()
}

/// SplitMix64 (Steele, Lea and Flood 2014), as a number in [0, 1).
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}
