//! Wavefront `.obj` meshes, and initial points on them.
//!
//! Positions, vertex colours and faces are read; materials, normals, texture coordinates and groups are skipped. `tobj`
//! parses, after a check of its input here: it computes with indices before it checks their range and reports no line.
//! It therefore gets only finite vertices and faces with valid indices.

use super::reader::{Reader, excerpt};
use super::source::Source;
use crate::error::{Error, Result};
use crate::scene::{Mesh, Point};
use crate::stats::SplitMix64;
use glam::Vec3;
use std::path::Path;

/// Longest line accepted, in bytes.
const LINE_BYTES_MAX: u64 = 1 << 24;

/// Reads a mesh; polygons become triangle fans. Vertices without a face are left out.
///
/// # Errors
/// Names the line: a coordinate that is missing or not finite, an index out of range, a face with less than three
/// corners. A mesh without faces is an error as well.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<Mesh> {
    let source = source.into();
    let path = source.name();
    let mut checked = CheckedObj::read(source, true)?;
    if (1..checked.vertices).contains(&checked.colored) {
        // Colours count only if every vertex has one; `tobj` pairs them by order and would mix them up.
        checked = CheckedObj::read(source, false)?;
    }
    let options = tobj::LoadOptions {
        triangulate: true,
        ..Default::default()
    };
    let mut text = checked.text.as_bytes();
    let no_materials = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) =
        tobj::load_obj_buf(&mut text, &options, no_materials).map_err(|error| Error::file(path, error.to_string()))?;
    let mut mesh = Mesh::default();
    for tobj::Model { mesh: part, .. } in models {
        let first = mesh.positions.len() as u32;
        let triples = |values: &[f32]| -> Vec<[f32; 3]> {
            let chunks = values.chunks_exact(3);
            chunks.map(|v| [v[0], v[1], v[2]]).collect()
        };
        mesh.positions.extend(triples(&part.positions));
        let colors = triples(&part.vertex_color).into_iter();
        mesh.colors.extend(colors.map(|color| color.map(|c| c.clamp(0.0, 1.0))));
        let corners = part.indices.chunks_exact(3);
        mesh.triangles
            .extend(corners.map(|t| [t[0], t[1], t[2]].map(|v| first + v)));
    }
    Ok(mesh)
}

/// Checked statements of a file: `v x y z` or `v x y z r g b`, and `f` with positive indices.
#[derive(Default)]
struct CheckedObj {
    text: String,
    vertices: u64,
    /// Vertices that have a colour.
    colored: u64,
    faces: u64,
    /// Highest vertex index used, from 0, and its line.
    highest: (u64, u64),
}

impl CheckedObj {
    fn read(source: Source<'_>, with_colors: bool) -> Result<CheckedObj> {
        let path = source.name();
        let mut reader = Reader::open(source)?;
        let mut checked = CheckedObj::default();
        let mut line = String::new();
        while reader.line(&mut line, LINE_BYTES_MAX)? {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("v") => checked.vertex(&reader, words, with_colors)?,
                Some("f") => checked.face(&reader, words)?,
                _ => {}
            }
        }
        if checked.faces == 0 {
            return Err(Error::file(path, "holds no faces"));
        }
        // Faces may precede their vertices, so indices are checked at the end.
        let (index, line) = checked.highest;
        if index >= checked.vertices {
            let what = format!(
                "line {line}: vertex {} does not exist, there are {}",
                index + 1,
                checked.vertices
            );
            return Err(Error::file(path, what));
        }
        Ok(checked)
    }

    /// Checks `x y z` and, if present and wanted, `r g b`.
    fn vertex<'a>(&mut self, reader: &Reader, words: impl Iterator<Item = &'a str>, with_colors: bool) -> Result<()> {
        let words: Vec<&str> = words.take(6).collect();
        for word in &words {
            if !word.parse().is_ok_and(|value: f32| value.is_finite()) {
                let what = format!("the coordinate {} is no finite number", excerpt(word));
                return Err(reader.fault_in_line(what));
            }
        }
        if words.len() < 3 {
            return Err(reader.fault_in_line("a vertex needs three coordinates"));
        }
        if self.vertices >= u64::from(u32::MAX) {
            return Err(reader.fault_in_line("more vertices than 32-bit indices can name"));
        }
        // Three further numbers are a colour; one is the weight of a rational curve, which `tobj` would
        // divide by.
        let colored = with_colors && words.len() == 6;
        self.statement("v", words[..if colored { 6 } else { 3 }].iter().copied());
        self.colored += u64::from(colored);
        self.vertices += 1;
        Ok(())
    }

    /// Checks the vertex index of each corner, counted from 1.
    fn face<'a>(&mut self, reader: &Reader, words: impl Iterator<Item = &'a str>) -> Result<()> {
        let mut corners = Vec::with_capacity(4);
        let known = self.vertices;
        for word in words {
            let index = word.split('/').next().unwrap_or_default();
            let vertex = match index.parse::<i64>() {
                Ok(i) if i > 0 => u64::try_from(i - 1).ok(),
                // Negative indices count back from the vertex read last.
                Ok(i) if i < 0 => known.checked_sub(i.unsigned_abs()),
                _ => None,
            };
            let vertex = vertex.filter(|v| *v < u64::from(u32::MAX)).ok_or_else(|| {
                let what = format!("{} names no vertex; {known} are known here", excerpt(word));
                reader.fault_in_line(what)
            })?;
            if vertex >= self.highest.0 {
                self.highest = (vertex, reader.line_number());
            }
            corners.push((vertex + 1).to_string());
        }
        match corners.len() {
            0 => return Err(reader.fault_in_line("a face without corners")),
            1 | 2 => return Err(reader.fault_in_line("a face needs three corners")),
            _ => self.statement("f", corners.iter().map(String::as_str)),
        }
        self.faces += 1;
        Ok(())
    }

    fn statement<'a>(&mut self, keyword: &str, words: impl Iterator<Item = &'a str>) {
        self.text.push_str(keyword);
        for word in words {
            self.text.push(' ');
            self.text.push_str(word);
        }
        self.text.push('\n');
    }
}

/// Vertices as points, grey if the mesh has no colours.
pub fn vertices(mesh: &Mesh) -> Vec<Point> {
    let grey = [0.5; 3];
    let points = mesh.positions.iter().enumerate();
    points
        .map(|(i, position)| Point {
            position: position.map(f64::from),
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
    let mut random = SplitMix64(seed);
    (0..count)
        .map(|_| {
            let at = random.unit() * area;
            // Rounding can put `at` on the total; the last triangle takes it.
            let index = area_until.partition_point(|until| *until <= at);
            let index = index.min(mesh.triangles.len() - 1);
            // Turk, "Generating random points in triangles", Graphics Gems I.
            let (root, v) = (random.unit().sqrt() as f32, random.unit() as f32);
            let weights = [1.0 - root, root * (1.0 - v), root * v];
            let blend = |corners: [[f32; 3]; 3]| -> [f32; 3] {
                let sum = |axis: usize| (0..3).map(|k| weights[k] * corners[k][axis]).sum();
                [sum(0), sum(1), sum(2)]
            };
            let colors = mesh.triangles[index].map(|v| mesh.colors.get(v as usize).copied());
            Point {
                position: blend(mesh.corners(index)).map(f64::from),
                color: blend(colors.map(|c| c.unwrap_or([0.5; 3]))),
            }
        })
        .collect()
}
