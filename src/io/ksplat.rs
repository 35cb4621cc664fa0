//! `.ksplat` scenes of GaussianSplats3D, version 0.1, for reading: sections with splats of 24 bytes and more, grouped
//! in buckets relative to whose centres positions are stored.
//!
//! Levels of compression: 0 is `f32` throughout; 1 has 16-bit positions and half floats; 2 has harmonics of 8 bits as
//! well. Colours and opacities are bytes at all levels, harmonics end at degree 2.

use super::loaded::{Collector, LoadedSplats, StoredAs, StoredSplat, logit_of_byte};
use super::reader::Reader;
use super::source::Source;
use crate::error::Result;
use crate::scene::{SH_C0, ScreenFilter, sh_coefficient_count};
use half::f16;

const HEADER_BYTES: usize = 4096;
const SECTION_HEADER_BYTES: usize = 1024;
/// Bytes of a bucket's centre.
const CENTER_BYTES: u64 = 12;
/// Code of a position in the middle, where a section does not say another.
const RANGE: u32 = 32_767;
/// Limit of harmonics in either direction, where the header does not say another.
const SH_LIMIT: f32 = 1.5;

/// KsplatCoding of all sections.
#[derive(Clone, Copy, Debug)]
struct KsplatCoding {
    /// 0 to 2.
    level: u16,
    /// Values of the harmonics' bytes 0 and 255 at level 2.
    sh_range: [f32; 2],
}

impl KsplatCoding {
    /// Bytes of the position, of a scale or rotation component, and of a harmonic.
    fn widths(self) -> [usize; 3] {
        match self.level {
            0 => [12, 4, 4],
            1 => [6, 2, 2],
            _ => [6, 2, 1],
        }
    }

    /// Bytes of a splat.
    fn record_bytes(self, sh_degree: u32) -> usize {
        let [position, component, harmonic] = self.widths();
        position + 7 * component + 4 + harmonic * 3 * (sh_coefficient_count(sh_degree) - 1)
    }
}

/// Header of a section.
#[derive(Clone, Copy, Debug)]
struct KsplatSection {
    count: u64,
    /// Splats for which there is room.
    room: u64,
    bucket_size: u64,
    buckets: u64,
    /// Edge of a bucket's cube, world units.
    block: f32,
    range: u32,
    full_buckets: u64,
    partial_buckets: u64,
    sh_degree: u32,
}

/// Reads a `.ksplat` scene. A section of a lower SH degree than others has harmonics of zero; one that was saved while
/// loading ends at the splats loaded, with a warning.
///
/// # Errors
/// Names the file and the place: another version or level, counts beyond the file, splats outside of all buckets.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let path = source.name();
    let mut reader = Reader::open(source)?;
    let header: [u8; HEADER_BYTES] = reader.array("the header of 4096 bytes")?;
    let (coding, room, stated) = parse_header(&reader, &header)?;
    let room = reader.check_count(room, SECTION_HEADER_BYTES as u64, "section headers")?;
    let mut sections = Vec::with_capacity(room);
    for _ in 0..room {
        sections.push(section(&mut reader, coding)?);
    }
    let degree = sections.iter().map(|s| s.sh_degree).max().unwrap_or(0);
    let count: u64 = sections.iter().map(|s| s.count).sum();
    let least = coding.record_bytes(0) as u64;
    let mut collector = Collector::new(
        reader.check_count(count, least, "splats")?,
        degree,
        ScreenFilter::Classic,
    );
    let mut warnings = Vec::new();
    let expected: u64 = sections.iter().map(|s| s.room).sum();
    if count < expected {
        warnings.push(format!(
            "{}: holds {count} of the {expected} splats for which it has room: saved while it was loading",
            path.display()
        ));
    } else if count != u64::from(stated) {
        warnings.push(format!(
            "{}: its header counts {stated} splats, its sections {count}; those of the sections were read",
            path.display()
        ));
    }
    for (i, section) in sections.iter().enumerate() {
        let is_last = i + 1 == sections.len();
        read_section(&mut reader, coding, section, is_last, degree, &mut collector)?;
    }
    if reader.remaining() > 0 && count == expected {
        let (path, rest) = (path.display(), reader.remaining());
        warnings.push(format!("{path}: the {rest} bytes after the last section were ignored"));
    }
    Ok(collector.finish(path, StoredAs::ply("KSPLAT"), warnings))
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(bytes, at))
}

/// KsplatCoding, number of section headers, and number of splats.
fn parse_header(reader: &Reader, header: &[u8; HEADER_BYTES]) -> Result<(KsplatCoding, u64, u32)> {
    let [major, minor, ..] = *header;
    if (major, minor) != (0, 1) {
        return Err(reader.fault(format!(
            "no KSPLAT scene, or of another version: {major}.{minor} in place of 0.1"
        )));
    }
    let level = u16_at(header, 20);
    if level > 2 {
        return Err(reader.fault(format!("compression level {level}; 0 to 2 are possible")));
    }
    let or = |value: f32, other: f32| if value == 0.0 { other } else { value };
    let coding = KsplatCoding {
        level,
        sh_range: [or(f32_at(header, 36), -SH_LIMIT), or(f32_at(header, 40), SH_LIMIT)],
    };
    Ok((coding, u32_at(header, 4).into(), u32_at(header, 16)))
}

/// Reads a section header.
fn section(reader: &mut Reader, coding: KsplatCoding) -> Result<KsplatSection> {
    let header: [u8; SECTION_HEADER_BYTES] = reader.array("a section header of 1024 bytes")?;
    let number = |at: usize| u64::from(u32_at(&header, at));
    let range = match u32_at(&header, 24) {
        0 => RANGE,
        range => range,
    };
    let section = KsplatSection {
        count: number(0),
        room: number(4),
        bucket_size: number(8),
        buckets: number(12),
        block: f32_at(&header, 16),
        range,
        full_buckets: number(32),
        partial_buckets: number(36),
        sh_degree: u16_at(&header, 40).into(),
    };
    let KsplatSection {
        count, room, sh_degree, ..
    } = section;
    if sh_degree > 2 {
        return Err(reader.fault(format!("SH degree {sh_degree} of a section; 0 to 2 are possible")));
    }
    if count > room {
        return Err(reader.fault(format!("a section of {count} splats has room for {room} only")));
    }
    let bucket_bytes = u16_at(&header, 20);
    if coding.level > 0 && section.buckets > 0 && u64::from(bucket_bytes) != CENTER_BYTES {
        return Err(reader.fault(format!("buckets of {bucket_bytes} bytes; all have {CENTER_BYTES}")));
    }
    Ok(section)
}

fn read_section(
    reader: &mut Reader,
    coding: KsplatCoding,
    section: &KsplatSection,
    is_last: bool,
    sh_degree: u32,
    collector: &mut Collector,
) -> Result<()> {
    let partial = reader.check_count(section.partial_buckets, 4, "lengths of partial buckets")?;
    let mut lengths = Vec::with_capacity(partial);
    for _ in 0..partial {
        lengths.push(u64::from(reader.u32("the lengths of partial buckets")?));
    }
    let buckets = reader.check_count(section.buckets, CENTER_BYTES, "centres of buckets")?;
    let mut centers = Vec::with_capacity(buckets);
    for _ in 0..buckets {
        let center: [u8; 12] = reader.array("the centres of buckets")?;
        centers.push([0, 4, 8].map(|at| f32_at(&center, at)));
    }
    let bytes = coding.record_bytes(section.sh_degree);
    reader.check_count(section.count, bytes as u64, "splats")?;
    let mut buckets = BucketWalk::new(section, lengths, centers);
    let mut record = vec![0; bytes];
    let mut sh = vec![0.0; 3 * sh_coefficient_count(sh_degree)];
    for _ in 0..section.count {
        let center = match coding.level {
            0 => [0.0; 3],
            _ => buckets
                .advance()
                .ok_or_else(|| reader.fault("a splat outside of all buckets of its section"))?,
        };
        reader.fill(&mut record, "a splat")?;
        collector.push(&splat(coding, section, center, &record, &mut sh));
    }
    // Rooms without a splat.
    match is_last && section.count < section.room {
        true => Ok(()),
        false => reader.skip((section.room - section.count) * bytes as u64, "the room of a section"),
    }
}

/// Centre of the bucket of each splat: full buckets first, then the partial ones.
struct BucketWalk {
    bucket_size: u64,
    full_buckets: u64,
    lengths: Vec<u64>,
    centers: Vec<[f32; 3]>,
    bucket: u64,
    /// Splats left in the bucket.
    left: u64,
}

impl BucketWalk {
    fn new(section: &KsplatSection, lengths: Vec<u64>, centers: Vec<[f32; 3]>) -> BucketWalk {
        let mut walk = BucketWalk {
            bucket_size: section.bucket_size,
            full_buckets: section.full_buckets,
            lengths,
            centers,
            bucket: 0,
            left: 0,
        };
        walk.left = walk.length(0);
        walk
    }

    fn length(&self, bucket: u64) -> u64 {
        if bucket < self.full_buckets {
            return self.bucket_size;
        }
        let partial = usize::try_from(bucket - self.full_buckets).unwrap_or(usize::MAX);
        self.lengths.get(partial).copied().unwrap_or(0)
    }

    fn advance(&mut self) -> Option<[f32; 3]> {
        // Ends with the centres, of which there are no more than the file holds.
        while self.left == 0 {
            self.bucket += 1;
            self.centers.get(self.bucket as usize)?;
            self.left = self.length(self.bucket);
        }
        self.left -= 1;
        self.centers.get(self.bucket as usize).copied()
    }
}

/// The splat of a record; `sh` has room for the harmonics of all sections.
fn splat<'a>(
    coding: KsplatCoding,
    section: &KsplatSection,
    center: [f32; 3],
    record: &[u8],
    sh: &'a mut [f32],
) -> StoredSplat<'a> {
    let [position, component, harmonic] = coding.widths();
    let float = |at: usize, width: usize| match width {
        4 => f32_at(record, at),
        _ => f16::from_bits(u16_at(record, at)).to_f32(),
    };
    let mean = |axis: usize| match coding.level {
        0 => f32_at(record, 4 * axis),
        _ => {
            let steps = f32::from(u16_at(record, 2 * axis)) - section.range as f32;
            steps * (section.block / 2.0 / section.range as f32) + center[axis]
        }
    };
    let rotation_at = position + 3 * component;
    let color_at = rotation_at + 4 * component;
    let sh_at = color_at + 4;
    let [least, greatest] = coding.sh_range;
    let coefficient = |i: usize| match harmonic {
        1 => least + f32::from(record[sh_at + i]) / 255.0 * (greatest - least),
        width => float(sh_at + width * i, width),
    };
    sh.fill(0.0);
    for (coefficient, byte) in sh.iter_mut().zip(&record[color_at..color_at + 3]) {
        *coefficient = (f32::from(*byte) / 255.0 - 0.5) / SH_C0;
    }
    // Of each band, the file has all coefficients of red, then of green, then of blue.
    for band in 1..=section.sh_degree {
        let (first, width) = (sh_coefficient_count(band - 1), 2 * band as usize + 1);
        for channel in 0..3 {
            for k in 0..width {
                sh[3 * (first + k) + channel] = coefficient(3 * (first - 1) + width * channel + k);
            }
        }
    }
    StoredSplat {
        mean: [mean(0), mean(1), mean(2)],
        quaternion: [0, 1, 2, 3].map(|i| float(rotation_at + component * i, component)),
        // The logarithm of a negative scale is NaN.
        log_scale: [0, 1, 2].map(|i| float(position + component * i, component).ln()),
        opacity_logit: logit_of_byte(record[color_at + 3]),
        sh,
    }
}
