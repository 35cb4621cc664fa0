//! Reading versions 1 to 4.
//!
//! Compressed contents are inflated in pieces and up to the size that the header states, so that a small file that
//! states much takes no more memory than it inflates to.

use super::super::loaded::{AxesBy, Collector, LoadedSplats, StoredAs, StoredSplat, logit_of_byte};
use super::super::reader::Reader;
use super::super::source::Source;
use super::extensions;
use super::header::{ANTIALIASED, ATTRIBUTES, EXTENSIONS, HEADER_BYTES, HEADER_BYTES_V4, MAGIC, SPARK_TREE, SpzHeader};
use super::steps;
use crate::error::{Error, Result};
use crate::scene::{Axes, ScreenFilter, sh_coefficient_count};
use flate2::bufread::GzDecoder;
use half::f16;
use std::io::Read;
use std::path::Path;

/// Largest ratio of deflate: 258 bytes by two codes of a bit each.
const DEFLATE_RATIO: u64 = 1032;
/// Largest ratio of the positions to the file in version 4, as in the `spz` library: that of zstd has no limit.
const ZSTD_RATIO: u64 = 1024;
/// Most bytes of extensions after the harmonics: those in use have 28.
const EXTENSION_BYTES_MAX: u64 = 1 << 16;
/// Largest window of a frame that does not state its size, 2^23 bytes: that of level 19.
const WINDOW_LOG_MAX: u32 = 23;

/// Attributes of all splats, with their properties.
struct Contents<'a> {
    header: SpzHeader,
    attributes: [&'a [u8]; 6],
    axes: Option<Axes>,
    warnings: Vec<String>,
}

/// Reads an SPZ scene of version 1 to 4, in the axes of the file: those of its extension, otherwise RUB. Harmonics of
/// degree 4 are left out. Contents of versions 1 to 3 need no gzip around them.
///
/// # Errors
/// Names the file and the place: no SPZ file, an unknown version, sizes that differ from the header or are beyond the
/// file, and damaged streams.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let path = source.name();
    let bytes = Reader::all(source)?;
    match *bytes {
        [0x1f, 0x8b, ..] => {
            let mut decoder = GzDecoder::new(&*bytes);
            let most = DEFLATE_RATIO * bytes.len() as u64;
            let body = read_stream(path, &mut decoder, most, "the inflated contents")?;
            let mut contents = body.contents(path)?;
            let rest = decoder.into_inner();
            if !body.more && !rest.is_empty() {
                let (path, rest) = (path.display(), rest.len());
                contents
                    .warnings
                    .push(format!("{path}: the {rest} bytes after the gzip stream were ignored"));
            }
            Ok(collect(path, contents))
        }
        [a, b, c, d, 4, 0, 0, 0, ..] if [a, b, c, d] == MAGIC => read_frames(path, &bytes),
        [a, b, c, d, ..] if [a, b, c, d] == MAGIC => {
            let body = read_stream(path, &mut &*bytes, bytes.len() as u64, "the file")?;
            Ok(collect(path, body.contents(path)?))
        }
        [] => Err(Error::file(path, "the file is empty")),
        _ => Err(Error::file(
            path,
            "byte 0: no SPZ scene: begins with neither \"NGSP\" nor a gzip stream",
        )),
    }
}

/// Contents of versions 1 to 3.
struct Body {
    header: SpzHeader,
    /// All attributes, one after the other.
    bytes: Vec<u8>,
    extensions: Vec<u8>,
    /// Whether bytes follow that are not read.
    more: bool,
}

/// Reads contents of versions 1 to 3; `most` is the most that the file can hold, and `place` names the contents.
fn read_stream(path: &Path, input: &mut impl Read, most: u64, place: &str) -> Result<Body> {
    let head = inflate(path, input, 0, HEADER_BYTES as u64, place)?;
    let Some(head) = head.first_chunk::<HEADER_BYTES>() else {
        let what = format!("byte {} of {place}: ends inside the header of 16 bytes", head.len());
        return Err(Error::file(path, what));
    };
    let header = SpzHeader::parse(path, head, &format!("byte 0 of {place}"))?;
    if header.version == 4 {
        let what = format!("byte 4 of {place}: version 4, which has no gzip stream around it");
        return Err(Error::file(path, what));
    }
    let sizes = header.sizes();
    let size = sizes.iter().sum::<u64>();
    if HEADER_BYTES as u64 + size > most {
        let what = format!(
            "byte 8 of {place}: {} splats of {} bytes are announced, but the file can hold {most} bytes at most",
            header.count,
            header.widths().iter().sum::<u64>()
        );
        return Err(Error::file(path, what));
    }
    let bytes = inflate(path, input, HEADER_BYTES as u64, size, place)?;
    let end = HEADER_BYTES as u64 + size;
    if (bytes.len() as u64) < size {
        let end_of = |i: usize| sizes[..=i].iter().sum::<u64>();
        let cut = (0..6).find(|i| end_of(*i) > bytes.len() as u64).unwrap_or(0);
        let what = format!(
            "byte {} of {place}: ends inside the {} of {} splats",
            HEADER_BYTES + bytes.len(),
            ATTRIBUTES[cut],
            header.count
        );
        return Err(Error::file(path, what));
    }
    let mut extensions = Vec::new();
    if header.flags & EXTENSIONS != 0 && header.flags & SPARK_TREE == 0 {
        extensions = inflate(path, input, end, EXTENSION_BYTES_MAX, place)?;
        if extensions.is_empty() {
            let what = format!("byte {end} of {place}: ends before the extensions that the header announces");
            return Err(Error::file(path, what));
        }
    }
    // The checksum of a gzip stream is compared on reaching its end.
    let more = !inflate(path, input, end + extensions.len() as u64, 1, place)?.is_empty();
    Ok(Body {
        header,
        bytes,
        extensions,
        more,
    })
}

/// At most `most` bytes from byte `at` of `place`; fewer if the input ends.
fn inflate(path: &Path, input: &mut impl Read, at: u64, most: u64, place: &str) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    match input.take(most).read_to_end(&mut bytes) {
        Ok(_) => Ok(bytes),
        Err(error) => {
            let at = at + bytes.len() as u64;
            let what = format!("byte {at} of {place}: damaged or cut off: {error}");
            Err(Error::file(path, what))
        }
    }
}

impl Body {
    fn contents(&self, path: &Path) -> Result<Contents<'_>> {
        let mut left = self.bytes.as_slice();
        let attributes = self.header.sizes().map(|size| {
            // In bounds: as many bytes have been read.
            let (attribute, rest) = left.split_at(size as usize);
            left = rest;
            attribute
        });
        let mut warnings = self.header.warnings(path);
        let place = format!("byte {} of the contents", HEADER_BYTES + self.bytes.len());
        let axes = extensions::parse(path, &self.extensions, &place, &mut warnings)?;
        if self.more && self.header.flags & SPARK_TREE == 0 {
            warnings.push(format!(
                "{}: the contents after the last splat were ignored",
                path.display()
            ));
        }
        Ok(Contents {
            header: self.header,
            attributes,
            axes,
            warnings,
        })
    }
}

/// Reads version 4.
fn read_frames(path: &Path, bytes: &[u8]) -> Result<LoadedSplats> {
    let fault = |at: usize, what: String| Err(Error::file(path, format!("byte {at}: {what}")));
    let Some(head) = bytes.first_chunk::<HEADER_BYTES_V4>() else {
        return fault(bytes.len(), "the file ends inside the header of 32 bytes".into());
    };
    let [first @ .., _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _] = *head;
    let header = SpzHeader::parse(path, &first, "byte 0")?;
    let most = (bytes.len() as u64 * ZSTD_RATIO / 9).min(i32::MAX as u64);
    if header.count > most {
        let (count, size) = (header.count, bytes.len());
        return fault(
            8,
            format!("{count} splats are announced; {most} are possible in a file of {size} bytes"),
        );
    }
    let sizes = header.sizes();
    let present: Vec<usize> = (0..6).filter(|i| sizes[*i] > 0).collect();
    let (streams, wanted) = (usize::from(head[15]), present.len());
    if streams != wanted {
        let degree = header.sh_degree;
        return fault(
            15,
            format!("{streams} streams; splats of SH degree {degree} have {wanted}"),
        );
    }
    let table_at = u32::from_le_bytes([head[16], head[17], head[18], head[19]]) as usize;
    let table = bytes
        .get(table_at..)
        .and_then(|rest| rest.split_at_checked(16 * streams));
    let Some((table, frames)) = table.filter(|_| table_at >= HEADER_BYTES_V4) else {
        let size = bytes.len();
        return fault(
            16,
            format!(
                "a table of {streams} streams at byte {table_at} does not fit between the header and the end at byte {size}"
            ),
        );
    };
    let mut warnings = header.warnings(path);
    let between = &bytes[HEADER_BYTES_V4..table_at];
    let axes = match header.flags & EXTENSIONS {
        0 => None,
        _ => extensions::parse(path, between, "byte 32", &mut warnings)?,
    };
    let frames_at = table_at + table.len();
    let frames = split_frames(
        path,
        table,
        frames,
        frames_at,
        &present.iter().map(|i| (*i, sizes[*i])).collect::<Vec<_>>(),
    )?;
    let mut streams: [Vec<u8>; 6] = Default::default();
    for (attribute, at, frame) in frames {
        streams[attribute] = inflate_frame(path, attribute, at, frame, sizes[attribute])?;
    }
    let attributes = streams.each_ref().map(Vec::as_slice);
    let contents = Contents {
        header,
        attributes,
        axes,
        warnings,
    };
    Ok(collect(path, contents))
}

/// Attribute, offset and bytes of each frame; `wanted` are attributes and uncompressed sizes.
fn split_frames<'a>(
    path: &Path,
    table: &[u8],
    mut left: &'a [u8],
    mut at: usize,
    wanted: &[(usize, u64)],
) -> Result<Vec<(usize, usize, &'a [u8])>> {
    let fault = |at: usize, what: String| Err(Error::file(path, format!("byte {at}: {what}")));
    let numbers = table
        .as_chunks::<8>()
        .0
        .iter()
        .map(|number| u64::from_le_bytes(*number));
    let numbers: Vec<u64> = numbers.collect();
    let table_at = at - table.len();
    let mut frames = Vec::new();
    for (i, &(attribute, size)) in wanted.iter().enumerate() {
        let (name, entry_at) = (ATTRIBUTES[attribute], table_at + 16 * i);
        let (compressed, uncompressed) = (numbers[2 * i], numbers[2 * i + 1]);
        if uncompressed != size {
            return fault(
                entry_at + 8,
                format!("{name} of {uncompressed} bytes; all splats have {size}"),
            );
        }
        let split = usize::try_from(compressed)
            .ok()
            .and_then(|size| left.split_at_checked(size));
        let Some((frame, rest)) = split else {
            let left = left.len();
            return fault(
                entry_at,
                format!("{name} of {compressed} compressed bytes, and {left} are left in the file"),
            );
        };
        frames.push((attribute, at, frame));
        (at, left) = (at + frame.len(), rest);
    }
    match left.len() {
        0 => Ok(frames),
        more => fault(at, format!("{more} bytes after the last stream")),
    }
}

/// Contents of a zstd frame that must be of this size.
fn inflate_frame(path: &Path, attribute: usize, at: usize, frame: &[u8], size: u64) -> Result<Vec<u8>> {
    let name = ATTRIBUTES[attribute];
    let fault = |what: String| Error::file(path, format!("byte {at}: the {name} {what}"));
    let stated = zstd::zstd_safe::get_frame_content_size(frame).ok().flatten();
    if let Some(stated) = stated.filter(|stated| *stated != size) {
        return Err(fault(format!("inflate to {stated} bytes; {size} are announced")));
    }
    let damaged = |error: std::io::Error| fault(format!("are damaged: {error}"));
    let mut decoder = zstd::stream::read::Decoder::with_buffer(frame)
        .map_err(damaged)?
        .single_frame();
    // Memory is that of the window, or of the contents if they are smaller and of a stated size.
    if stated.is_none() {
        decoder.window_log_max(WINDOW_LOG_MAX).map_err(damaged)?;
    }
    let mut bytes = Vec::new();
    decoder
        .by_ref()
        .take(size + 1)
        .read_to_end(&mut bytes)
        .map_err(damaged)?;
    if bytes.len() as u64 != size {
        let relation = if bytes.len() as u64 > size {
            "more than"
        } else {
            "fewer than"
        };
        return Err(fault(format!("inflate to {relation} the {size} bytes announced")));
    }
    match decoder.finish().len() {
        0 => Ok(bytes),
        more => Err(fault(format!("end {more} bytes before their stream"))),
    }
}

fn collect(path: &Path, contents: Contents) -> LoadedSplats {
    let Contents {
        header,
        attributes: [positions, alphas, colors, scales, rotations, harmonics],
        axes,
        warnings,
    } = contents;
    let filter = match header.flags & ANTIALIASED {
        0 => ScreenFilter::Classic,
        _ => ScreenFilter::Mip,
    };
    let degree = header.sh_degree.min(3);
    let kept = 3 * (sh_coefficient_count(degree) - 1);
    let [position_width, _, _, _, rotation_width, sh_width] = header.widths().map(|width| width as usize);
    // Sizes have been compared with the contents.
    let mut collector = Collector::new(alphas.len(), degree, filter);
    let mut sh = Vec::with_capacity(3 + kept);
    for (i, &alpha) in alphas.iter().enumerate() {
        sh.clear();
        sh.extend(three(colors, i).map(steps::color));
        sh.extend(harmonics[i * sh_width..][..kept].iter().map(|code| steps::sh(*code)));
        collector.push(&StoredSplat {
            mean: mean(
                &positions[i * position_width..][..position_width],
                header.fractional_bits,
            ),
            quaternion: match rotations[i * rotation_width..][..rotation_width] {
                [a, b, c, d] => steps::rotation(u32::from_le_bytes([a, b, c, d])),
                _ => steps::rotation_of_bytes(three(rotations, i)),
            },
            log_scale: three(scales, i).map(steps::scale),
            opacity_logit: logit_of_byte(alpha),
            sh: &sh,
        });
    }
    let stored = StoredAs {
        format: format!("SPZ {}", header.version),
        axes: axes.unwrap_or(Axes::RUB),
        axes_by: if axes.is_some() {
            AxesBy::File
        } else {
            AxesBy::Assumption
        },
    };
    collector.finish(path, stored, warnings)
}

fn three(bytes: &[u8], i: usize) -> [u8; 3] {
    [bytes[3 * i], bytes[3 * i + 1], bytes[3 * i + 2]]
}

/// Position of its bytes: half floats in version 1, otherwise 24 bits each.
fn mean(bytes: &[u8], fractional_bits: u32) -> [f32; 3] {
    [0, 1, 2].map(|axis| match bytes.len() {
        6 => f16::from_le_bytes([bytes[2 * axis], bytes[2 * axis + 1]]).to_f32(),
        _ => steps::position(steps::position_of_bytes(three(bytes, axis)), fractional_bits),
    })
}
