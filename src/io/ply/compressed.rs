//! Compressed `.ply` scenes of the PlayCanvas family: 16 bytes a splat in chunks of 256, and a byte for each harmonic.
//!
//! No specification exists; the layout is that of the writer splat-transform. Elements in order: `chunk` (ranges of
//! positions, log-scales and, in newer files, colours), `vertex` (four packed `u32`) and, for harmonics, `sh` (a byte
//! for each `f_rest`). An empty band is left out, because no code stands for zero.

use super::super::atomic::write_atomically;
use super::comments::comments;
use super::header::{Encoding, PlyElement, PlyHeader, Scalar};
use super::rows;
use crate::error::{Error, Result};
use crate::io::loaded::{Collector, LoadedSplats, StoredAs, StoredSplat, logit_of_byte, opacity};
use crate::io::reader::{Reader, excerpt};
use crate::scene::{SH_C0, Splats, kd_order, sh_coefficient_count};
use glam::Vec4;
use rayon::prelude::*;
use std::f32::consts::SQRT_2;
use std::io::Write;
use std::path::Path;

/// Splats of a chunk.
pub const CHUNK: usize = 256;

/// Largest magnitude of a log-scale in the file.
const LOG_SCALE_MAX: f32 = 20.0;

/// Smaller ranges of a chunk are no range: all codes are zero.
const RANGE_MIN: f32 = 1e-5;

/// Bits of x, y and z of packed positions and log-scales.
const XYZ_BITS: [u32; 3] = [11, 10, 11];

/// Bits of each of the three smaller components of a quaternion.
const QUATERNION_BITS: u32 = 10;

/// Names of a chunk's properties; older files end after the log-scales.
const CHUNK_NAMES: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];

/// Names of a vertex's properties.
const VERTEX_NAMES: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// Quantised scene in the layout of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CompressedPlyCodes {
    /// Ranges of each chunk of 256 splats: minima and maxima of x, y, z, of three log-scales, and of three colours as
    /// 0.5 + C0 · `f_dc`.
    pub chunks: Vec<[f32; 18]>,
    /// Position (11, 10 and 11 bits), rotation (index of the largest component, then 10 bits for each other one),
    /// log-scale (11, 10 and 11 bits), and red, green, blue and opacity (8 bits each) of each splat; first ones
    /// highest.
    pub vertices: Vec<[u32; 4]>,
    /// Harmonics above degree 0, `[splat][coefficient][rgb]`: (code + ½) / 32 − 4, but −4 and 4 at the ends.
    pub sh: Vec<u8>,
    /// Empty splats with kind, filter, origin, upward direction and SH degree of the scene.
    pub scene: Splats,
}

impl CompressedPlyCodes {
    /// Rounds every attribute to its nearest code, in the order of a k-d tree of the means.
    pub fn nearest(splats: &Splats) -> CompressedPlyCodes {
        let order: Vec<usize> = kd_order(&splats.mean, CHUNK).iter().map(|&i| i as usize).collect();
        let chunked: Vec<_> = order.par_chunks(CHUNK).map(|chunk| pack_chunk(splats, chunk)).collect();
        let degree = splats.used_sh_degree();
        let rest = 3 * (sh_coefficient_count(degree) - 1);
        let coefficients = |&i: &usize| &splats.sh[i * splats.sh_stride() + 3..][..rest];
        CompressedPlyCodes {
            chunks: chunked.iter().map(|(range, _)| *range).collect(),
            vertices: chunked.into_iter().flat_map(|(_, vertices)| vertices).collect(),
            sh: order.iter().flat_map(coefficients).map(|&v| sh_code(v)).collect(),
            scene: Splats {
                sh_degree: degree,
                filter: splats.filter,
                origin: splats.origin,
                up: splats.up,
                ..Splats::default()
            },
        }
    }

    /// Splats that a reader of the file gets.
    pub fn decode(&self) -> Splats {
        self.collect(Path::new("codes"), Vec::new()).splats
    }

    fn collect(&self, path: &Path, warnings: Vec<String>) -> LoadedSplats {
        let rest = 3 * (sh_coefficient_count(self.scene.sh_degree) - 1);
        let mut collector = Collector::new(self.vertices.len(), self.scene.sh_degree, self.scene.filter);
        let mut sh = vec![0.0; 3 + rest];
        for (i, vertex) in self.vertices.iter().enumerate() {
            let codes = &self.sh[i * rest..][..rest];
            let mut splat = unpack(*vertex, &self.chunks[i / CHUNK]);
            sh[..3].copy_from_slice(&splat.1);
            sh[3..].iter_mut().zip(codes).for_each(|(v, &code)| *v = sh_value(code));
            splat.0.sh = &sh;
            collector.push(&splat.0);
        }
        let mut loaded = collector.finish(path, StoredAs::ply("compressed PLY"), warnings);
        loaded.splats.origin = self.scene.origin;
        loaded.splats.up = self.scene.up;
        loaded.splats.primitive = self.scene.primitive;
        loaded.splats.set_thickness();
        loaded
    }

    /// Bytes of the file.
    pub fn byte_count(&self) -> u64 {
        let bodies = size_of_val(&self.chunks[..]) + size_of_val(&self.vertices[..]) + self.sh.len();
        (self.header().len() + bodies) as u64
    }

    fn header(&self) -> String {
        let mut text = format!("ply\nformat binary_little_endian 1.0\n{}", comments(&self.scene));
        let mut element = |name: &str, count: usize, kind: &str, properties: &[String]| {
            text += &format!("element {name} {count}\n");
            properties
                .iter()
                .for_each(|p| text += &format!("property {kind} {p}\n"));
        };
        element("chunk", self.chunks.len(), "float", &CHUNK_NAMES.map(String::from));
        element("vertex", self.vertices.len(), "uint", &VERTEX_NAMES.map(String::from));
        let rest = 3 * (sh_coefficient_count(self.scene.sh_degree) - 1);
        if rest > 0 {
            let names: Vec<String> = (0..rest).map(|i| format!("f_rest_{i}")).collect();
            element("sh", self.vertices.len(), "uchar", &names);
        }
        text + "end_header\n"
    }

    /// Writes the file atomically.
    ///
    /// # Errors
    /// Those of the operating system.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_atomically(path, |file| {
            file.write_all(self.header().as_bytes())?;
            for value in self.chunks.iter().flatten() {
                file.write_all(&value.to_le_bytes())?;
            }
            for value in self.vertices.iter().flatten() {
                file.write_all(&value.to_le_bytes())?;
            }
            let rest = 3 * (sh_coefficient_count(self.scene.sh_degree) - 1);
            for row in self.sh.chunks_exact(rest.max(1)) {
                // The file has all coefficients of red, then of green, then of blue.
                let of = |channel: usize| row.iter().skip(channel).step_by(3).copied();
                let bytes: Vec<u8> = (0..3).flat_map(of).collect();
                file.write_all(&bytes)?;
            }
            Ok(())
        })
    }
}

/// Writes a compressed `.ply`, every attribute rounded to its nearest code.
///
/// # Errors
/// Those of the operating system.
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    CompressedPlyCodes::nearest(splats).write(path)
}

/// Values of a splat that have ranges: position, log-scale and colour.
fn ranged(splats: &Splats, i: usize) -> [f32; 9] {
    let [x, y, z] = splats.mean[i];
    let [a, b, c] = splats.log_scale[i].map(|s| s.clamp(-LOG_SCALE_MAX, LOG_SCALE_MAX));
    let sh = &splats.sh[i * splats.sh_stride()..];
    let [red, green, blue] = [sh[0], sh[1], sh[2]].map(|v| 0.5 + SH_C0 * v);
    [x, y, z, a, b, c, red, green, blue]
}

/// Range and vertices of the splats of a chunk.
fn pack_chunk(splats: &Splats, chunk: &[usize]) -> ([f32; 18], Vec<[u32; 4]>) {
    let (mut min, mut max) = ([f32::INFINITY; 9], [f32::NEG_INFINITY; 9]);
    for &i in chunk {
        let values = ranged(splats, i);
        for k in 0..9 {
            min[k] = min[k].min(values[k]);
            max[k] = max[k].max(values[k]);
        }
    }
    let code = |values: &[f32; 9], k: usize, bits: u32| match max[k] - min[k] {
        range if range < RANGE_MIN => 0,
        range => unit_code((values[k] - min[k]) / range, bits),
    };
    let xyz = |values: &[f32; 9], first: usize| {
        let packed = (0..3).map(|axis| (XYZ_BITS[axis], code(values, first + axis, XYZ_BITS[axis])));
        packed.fold(0, |all, (bits, code)| all << bits | code)
    };
    let pack = |&i: &usize| {
        let values = ranged(splats, i);
        let opacity = opacity(splats.opacity_logit[i]);
        let color = (6..9).fold(0, |all, k| all << 8 | code(&values, k, 8));
        [
            xyz(&values, 0),
            pack_quaternion(splats.quaternion[i]),
            xyz(&values, 3),
            color << 8 | unit_code(opacity, 8),
        ]
    };
    let mut range = [0.0; 18];
    for kind in 0..3 {
        range[6 * kind..][..3].copy_from_slice(&min[3 * kind..][..3]);
        range[6 * kind + 3..][..3].copy_from_slice(&max[3 * kind..][..3]);
    }
    (range, chunk.iter().map(pack).collect())
}

/// Splat of a vertex without harmonics, and its three coefficients of degree 0.
fn unpack(vertex: [u32; 4], range: &[f32; 18]) -> (StoredSplat<'static>, [f32; 3]) {
    let between = |kind: usize, axis: usize, share: f32| {
        let (min, max) = (range[6 * kind + axis], range[6 * kind + 3 + axis]);
        min + (max - min) * share
    };
    let xyz = |kind: usize, packed: u32| {
        let codes = [packed >> 21, packed >> 11 & 0x3ff, packed & 0x7ff];
        [0, 1, 2].map(|axis| between(kind, axis, unit_value(codes[axis], XYZ_BITS[axis])))
    };
    let [red, green, blue, opacity] = vertex[3].to_be_bytes();
    let color = [red, green, blue].map(|byte| unit_value(byte.into(), 8));
    let sh = [0, 1, 2].map(|channel| (between(2, channel, color[channel]) - 0.5) / SH_C0);
    let splat = StoredSplat {
        mean: xyz(0, vertex[0]),
        quaternion: unpack_quaternion(vertex[1]),
        log_scale: xyz(1, vertex[2]),
        opacity_logit: logit_of_byte(opacity),
        sh: &[],
    };
    (splat, sh)
}

/// Nearest code of a value from 0 to 1.
fn unit_code(value: f32, bits: u32) -> u32 {
    let codes = (1u32 << bits) - 1;
    // NaN becomes 0.
    (value * codes as f32).round().clamp(0.0, codes as f32) as u32
}

/// Value from 0 to 1 of a code.
fn unit_value(code: u32, bits: u32) -> f32 {
    code as f32 / ((1u32 << bits) - 1) as f32
}

/// Packs a quaternion w, x, y, z of any length.
fn pack_quaternion(quaternion: [f32; 4]) -> u32 {
    let q = Vec4::from(quaternion).normalize_or(Vec4::X);
    let largest = q.abs().max_position();
    let q = q.to_array().map(|v| v * q[largest].signum());
    let others = (0..4).filter(|&i| i != largest);
    others.fold(largest as u32, |all, i| {
        all << QUATERNION_BITS | unit_code(q[i] / SQRT_2 + 0.5, QUATERNION_BITS)
    })
}

/// Quaternion w, x, y, z of a packed one.
fn unpack_quaternion(packed: u32) -> [f32; 4] {
    let codes = [packed >> 20 & 0x3ff, packed >> 10 & 0x3ff, packed & 0x3ff];
    let mut others = codes
        .map(|c| (unit_value(c, QUATERNION_BITS) - 0.5) * SQRT_2)
        .into_iter();
    let squares: f32 = others.clone().map(|v| v * v).sum();
    let largest = (packed >> 30) as usize;
    let rest = (1.0 - squares).max(0.0).sqrt();
    [0, 1, 2, 3].map(|i| match i == largest {
        true => rest,
        false => others.next().unwrap_or(0.0),
    })
}

/// Nearest code of a harmonic.
fn sh_code(value: f32) -> u8 {
    // The codes' values lie in the middle of the intervals of this floor; casts saturate.
    (32.0 * (value + 4.0)).floor() as u8
}

/// Value of a harmonic's code.
fn sh_value(code: u8) -> f32 {
    match code {
        0 => -4.0,
        255 => 4.0,
        other => (f32::from(other) + 0.5) / 32.0 - 4.0,
    }
}

/// Reads a compressed `.ply` behind its header. `scene` holds kind, filter, origin and upward direction.
pub(super) fn read(
    mut reader: Reader,
    header: &PlyHeader,
    scene: Splats,
    warnings: Vec<String>,
) -> Result<LoadedSplats> {
    let path = reader.path();
    let mut codes = CompressedPlyCodes {
        scene,
        ..CompressedPlyCodes::default()
    };
    check_counts(header).map_err(|what| Error::file(path, what))?;
    for element in &header.elements {
        let encoding = header.encoding;
        match element.name.as_str() {
            "chunk" => codes.chunks = read_chunks(&mut reader, encoding, element)?,
            "vertex" => codes.vertices = read_vertices(&mut reader, encoding, element)?,
            "sh" => (codes.sh, codes.scene.sh_degree) = read_sh(&mut reader, encoding, element)?,
            _ => rows::skip(&mut reader, encoding, element)?,
        }
    }
    Ok(codes.collect(path, warnings))
}

/// Compares the announced counts with each other, before any row is read.
fn check_counts(header: &PlyHeader) -> std::result::Result<(), String> {
    let announced = |name: &str| header.element(name).map(|(_, element)| element.count);
    let required = |name: &str| announced(name).ok_or(format!("has no element \"{name}\""));
    let (chunks, count) = (required("chunk")?, required("vertex")?);
    if chunks != count.div_ceil(CHUNK as u64) {
        return Err(format!("{chunks} chunks of {CHUNK} splats, but {count} splats"));
    }
    match announced("sh") {
        Some(harmonics) if harmonics != count => Err(format!("{harmonics} rows of harmonics, but {count} splats")),
        _ => Ok(()),
    }
}

/// Columns of these names, all of one type.
fn columns<'n>(
    reader: &Reader,
    element: &PlyElement,
    names: impl IntoIterator<Item = &'n str>,
    scalar: Scalar,
) -> Result<Vec<usize>> {
    let column = |name: &str| {
        let found = element.find(name).filter(|&i| {
            let property = &element.properties[i];
            property.scalar == scalar && property.list.is_none()
        });
        found.ok_or_else(|| {
            let (kind, element) = (scalar.name(), excerpt(&element.name));
            let what = format!("element {element} has no property {} of type {kind}", excerpt(name));
            Error::file(reader.path(), what)
        })
    };
    names.into_iter().map(column).collect()
}

/// Reads the rows of an element by these columns.
fn read_rows(
    reader: &mut Reader,
    encoding: Encoding,
    element: &PlyElement,
    columns: &[usize],
    each: impl FnMut(&[f64]),
) -> Result<()> {
    if let Some(list) = element.properties.iter().find(|p| p.list.is_some()) {
        let what = format!("the property {} is a list", excerpt(&list.name));
        return Err(Error::file(reader.path(), what));
    }
    rows::check_count(reader, encoding, element)?;
    rows::read(reader, encoding, element, columns, each)
}

fn read_chunks(reader: &mut Reader, encoding: Encoding, element: &PlyElement) -> Result<Vec<[f32; 18]>> {
    let has_colors = element.find("min_r").is_some();
    let names = &CHUNK_NAMES[..if has_colors { 18 } else { 12 }];
    let columns = columns(reader, element, names.iter().copied(), Scalar::F32)?;
    let mut chunks = Vec::new();
    read_rows(reader, encoding, element, &columns, |row| {
        // Older files: colours from 0 to 1.
        let mut range = [0.0; 18];
        range[15..].fill(1.0);
        range.iter_mut().zip(row).for_each(|(r, v)| *r = *v as f32);
        chunks.push(range);
    })?;
    Ok(chunks)
}

fn read_vertices(reader: &mut Reader, encoding: Encoding, element: &PlyElement) -> Result<Vec<[u32; 4]>> {
    let columns = columns(reader, element, VERTEX_NAMES, Scalar::U32)?;
    let mut vertices = Vec::new();
    read_rows(reader, encoding, element, &columns, |row| {
        vertices.push([row[0], row[1], row[2], row[3]].map(|v| v as u32));
    })?;
    Ok(vertices)
}

/// Codes `[splat][coefficient][rgb]` and their SH degree.
fn read_sh(reader: &mut Reader, encoding: Encoding, element: &PlyElement) -> Result<(Vec<u8>, u32)> {
    let rest = element
        .properties
        .iter()
        .filter(|p| p.name.starts_with("f_rest_"))
        .count();
    let Some(degree) = (1..=3).find(|&d| 3 * (sh_coefficient_count(d) - 1) == rest) else {
        let what = format!("{rest} f_rest properties; 9, 24 or 45 are possible");
        return Err(Error::file(reader.path(), what));
    };
    // The file has all coefficients of red, then of green, then of blue.
    let names: Vec<String> = (0..rest)
        .map(|i| format!("f_rest_{}", i % 3 * (rest / 3) + i / 3))
        .collect();
    let columns = columns(reader, element, names.iter().map(String::as_str), Scalar::U8)?;
    let mut codes = Vec::new();
    read_rows(reader, encoding, element, &columns, |row| {
        codes.extend(row.iter().map(|&v| v as u8))
    })?;
    Ok((codes, degree))
}
