//! `.splat` files: 32 bytes a splat, no header, SH degree 0.
//!
//! A record is three `f32` of position, three of scale (not its logarithm), colour and opacity as
//! RGBA bytes, and the quaternion w, x, y, z as bytes `128 + 128 q`.

use super::ply::LoadedSplats;
use super::reader::Reader;
use super::source::Source;
use crate::error::Result;
use crate::scene::{SH_C0, Splats};

const RECORD_BYTES: u64 = 32;

/// Smallest scale read, in world units; lower ones are clamped, as zero has no logarithm.
const SCALE_MIN: f32 = 1e-10;

/// Reads a `.splat` file. Records with positions or scales that are not finite, or negative scales,
/// are dropped; quaternions of length zero are read as no rotation; an incomplete record at the end is
/// ignored. Each is counted in a warning.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let path = source.name();
    let mut reader = Reader::open(source)?;
    let count = (reader.size() / RECORD_BYTES) as usize;
    let mut splats = Splats::default();
    let (mut dropped, mut unrotated) = (0, 0);
    for _ in 0..count {
        let record: [u8; 32] = reader.array("a record")?;
        let number = |i: usize| {
            let at = 4 * i;
            f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
        };
        let mean = [number(0), number(1), number(2)];
        let scale = [number(3), number(4), number(5)];
        let finite = mean.iter().chain(&scale).all(|v| v.is_finite());
        if !finite || scale.iter().any(|s| *s < 0.0) {
            dropped += 1;
            continue;
        }
        let mut quaternion = [28, 29, 30, 31].map(|i| (f32::from(record[i]) - 128.0) / 128.0);
        if quaternion == [0.0; 4] {
            unrotated += 1;
            quaternion[0] = 1.0;
        }
        splats.mean.push(mean);
        splats.log_scale.push(scale.map(|s| s.max(SCALE_MIN).ln()));
        splats.quaternion.push(quaternion);
        splats.opacity_logit.push(logit(record[27]));
        splats
            .sh
            .extend([24, 25, 26].map(|i| (f32::from(record[i]) / 255.0 - 0.5) / SH_C0));
    }
    let mut warnings = Vec::new();
    let mut warn = |happened: bool, what: String| {
        if happened {
            warnings.push(format!("{}: {what}", path.display()));
        }
    };
    let odd = reader.remaining();
    warn(odd > 0, format!("the {odd} bytes after the last record were ignored"));
    warn(
        dropped > 0,
        format!("{dropped} of {count} splats hold values that are not finite or negative scales and were dropped"),
    );
    warn(
        unrotated > 0,
        format!("{unrotated} of {count} splats have a quaternion of length zero, read as no rotation"),
    );
    warn(splats.is_empty(), "holds no splats".to_owned());
    Ok(LoadedSplats { splats, warnings })
}

/// Logit of an opacity in 255ths. The ends stand for the middle of their rounding interval, because their own logits
/// are infinite.
fn logit(byte: u8) -> f32 {
    let opacity = match byte {
        0 => 0.25,
        255 => 254.75,
        other => f32::from(other),
    } / 255.0;
    (opacity / (1.0 - opacity)).ln()
}
