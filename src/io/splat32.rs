//! `.splat` files: 32 bytes a splat, no header, SH degree 0.
//!
//! A record is three `f32` of position, three of scale (not its logarithm), colour and opacity as
//! RGBA bytes, and the quaternion w, x, y, z as bytes `128 + 128 q`.

use super::atomic::write_atomically;
use super::loaded::{Collector, LoadedSplats, StoredAs, StoredSplat, logit_of_byte, opacity};
use super::reader::Reader;
use super::source::Source;
use crate::error::Result;
use crate::scene::{SH_C0, ScreenFilter, Splats};
use glam::Vec4;
use std::io::Write;
use std::path::Path;

const RECORD_BYTES: u64 = 32;

/// Reads a `.splat` file. Records with positions or scales that are not finite, or negative scales, are dropped;
/// quaternions of length zero are read as no rotation; an incomplete record at the end is ignored. Each is counted in a
/// warning.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let path = source.name();
    let mut reader = Reader::open(source)?;
    let count = (reader.size() / RECORD_BYTES) as usize;
    let mut collector = Collector::new(count, 0, ScreenFilter::Classic);
    for _ in 0..count {
        push(&mut collector, &reader.array("a record")?);
    }
    let odd = reader.remaining();
    let odd = (odd > 0).then(|| format!("{}: the {odd} bytes after the last record were ignored", path.display()));
    Ok(collector.finish(path, StoredAs::ply("splat"), odd.into_iter().collect()))
}

/// Collects the splat of a record.
fn push(collector: &mut Collector, record: &[u8; RECORD_BYTES as usize]) {
    let number = |i: usize| {
        let at = 4 * i;
        f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
    };
    let [r, g, b, opacity, rotation @ ..] = *record.last_chunk::<8>().unwrap_or(&[0; 8]);
    collector.push(&StoredSplat {
        mean: [number(0), number(1), number(2)],
        quaternion: rotation.map(|q| (f32::from(q) - 128.0) / 128.0),
        // The logarithm of a negative scale is NaN.
        log_scale: [number(3), number(4), number(5)].map(f32::ln),
        opacity_logit: logit_of_byte(opacity),
        sh: &[r, g, b].map(|c| (f32::from(c) / 255.0 - 0.5) / SH_C0),
    });
}

/// Splats that a reader gets of the file that [`write()`] writes.
pub fn decoded(splats: &Splats) -> Splats {
    let mut collector = Collector::new(splats.len(), 0, ScreenFilter::Classic);
    (0..splats.len()).for_each(|i| push(&mut collector, &record(splats, i)));
    collector
        .finish(Path::new("splats"), StoredAs::default(), Vec::new())
        .splats
}

/// Bytes of the file that [`write()`] writes.
pub fn byte_count(splats: &Splats) -> u64 {
    RECORD_BYTES * splats.len() as u64
}

/// Writes a `.splat` file atomically, every byte rounded to its nearest value, in the order of the splats. Harmonics
/// above degree 0 have no place.
///
/// # Errors
/// Those of the operating system.
pub fn write(path: &Path, splats: &Splats) -> Result<()> {
    write_atomically(path, |file| {
        (0..splats.len()).try_for_each(|i| file.write_all(&record(splats, i)))
    })
}

/// Record of a splat.
fn record(splats: &Splats, i: usize) -> [u8; RECORD_BYTES as usize] {
    // Casts of floats saturate.
    let byte = |value: f32| value.round() as u8;
    let opacity = opacity(splats.opacity_logit[i]);
    let sh = &splats.sh[i * splats.sh_stride()..][..3];
    let quaternion = Vec4::from(splats.quaternion[i]).normalize_or(Vec4::X).to_array();
    let mut record = [0; RECORD_BYTES as usize];
    let floats = splats.mean[i].into_iter().chain(splats.log_scale[i].map(f32::exp));
    for (bytes, value) in record.chunks_exact_mut(4).zip(floats) {
        bytes.copy_from_slice(&value.to_le_bytes());
    }
    for channel in 0..3 {
        record[24 + channel] = byte(255.0 * (0.5 + SH_C0 * sh[channel]));
    }
    record[27] = byte(255.0 * opacity);
    for (byte_of, q) in record[28..].iter_mut().zip(quaternion) {
        *byte_of = byte(128.0 + 128.0 * q);
    }
    record
}
