//! Photograph sizes from file headers, detection of truncated files, and formats that others must convert.

use super::super::listing::check_size;
use super::super::reader::Reader;
use super::super::source::Source;
use super::SIDE_MIN;
use crate::error::{Error, Result};
use image::{ImageFormat, ImageReader};
use std::io::Cursor;
use std::path::Path;

const PNG_MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";

/// Width and height of a PNG, JPEG, WebP or TIFF file in pixels, without decoding it.
///
/// # Errors
/// Names the file: empty, of another format, or of an invalid size.
pub fn dimensions<'a>(source: impl Into<Source<'a>>) -> Result<(u32, u32)> {
    let source = source.into();
    let path = source.name();
    let mut reader = Reader::open(source)?;
    if reader.size() == 0 {
        return Err(Error::file(path, "the file is empty"));
    }
    let mut magic = [0; 2];
    let known = reader.fill(&mut magic, "the magic").is_ok();
    let (width, height) = match magic {
        [0xff, 0xd8] if known => jpeg(&mut reader)?,
        [0x89, b'P'] if known => png(&mut reader)?,
        _ => other(source)?,
    };
    let size = check_size(width, height).map_err(|what| Error::file(path, what))?;
    if size.0 < SIDE_MIN || size.1 < SIDE_MIN {
        let what = format!("is {width} x {height} pixels; at least {SIDE_MIN} x {SIDE_MIN} are needed");
        return Err(Error::file(path, what));
    }
    let per_byte = match magic[0] {
        0xff => JPEG_PIXELS_MAX,
        _ => PNG_PIXELS_MAX,
    };
    if width * height > per_byte * reader.size() {
        let what = format!(
            "announces {width} x {height} pixels, more than its {} bytes can hold",
            reader.size()
        );
        return Err(Error::file(path, what));
    }
    Ok(size)
}

/// Extensions of raw files, which begin like TIFF ones.
const RAW: [&str; 10] = ["dng", "nef", "nrw", "cr2", "cr3", "arw", "orf", "raf", "rw2", "pef"];

/// Name of a format that others must convert, and the command.
fn foreign(path: &Path, head: &[u8]) -> Option<(&'static str, &'static str)> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let raw = ("a raw image", "dcraw -w -T FILE (package dcraw)");
    let is_raw = RAW.iter().any(|known| known.eq_ignore_ascii_case(extension));
    let brand = head.get(4..12).unwrap_or_default();
    match brand {
        b"ftypavif" | b"ftypavis" => Some(("an AVIF image", "heif-convert FILE FILE.png (package libheif-examples)")),
        b"ftypcrx " => Some(raw),
        [b'f', b't', b'y', b'p', ..] => {
            Some(("an HEIC image", "heif-convert FILE FILE.png (package libheif-examples)"))
        }
        _ if is_raw || head.starts_with(b"FUJIFILMCCD-RAW") => Some(raw),
        _ => None,
    }
}

/// Size of a WebP or TIFF file.
fn other(source: Source<'_>) -> Result<(u64, u64)> {
    let path = source.name();
    let bytes = Reader::all(source)?;
    if let Some((format, command)) = foreign(path, &bytes) {
        let what = format!("is {format}, which is not read: convert the photographs first, {command}");
        return Err(Error::file(path, what));
    }
    let format = match bytes.as_ref() {
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => ImageFormat::WebP,
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => ImageFormat::Tiff,
        _ => return Err(Error::file(path, "is neither a PNG nor a JPEG, WebP or TIFF image")),
    };
    let reader = ImageReader::with_format(Cursor::new(bytes.as_ref()), format);
    let size = reader.into_dimensions();
    let (width, height) = size.map_err(|e| Error::file(path, format!("cannot be decoded: {e}")))?;
    Ok((width.into(), height.into()))
}

/// Upper bound of pixels per byte of a JPEG file: each block of 8 x 8 takes one bit at least.
const JPEG_PIXELS_MAX: u64 = 8 * 64;

/// Upper bound of pixels per byte of other files: deflate makes at most 1,032 bytes of one, each with at most eight
/// pixels; photographs in WebP and TIFF stay far below it, too.
const PNG_PIXELS_MAX: u64 = 1032 * 8;

/// PNG after the first two bytes: the rest of the magic, then the chunk IHDR.
fn png(reader: &mut Reader) -> Result<(u64, u64)> {
    let rest: [u8; 14] = reader.array("the PNG header")?;
    if rest[..6] != PNG_MAGIC[2..] || &rest[10..] != b"IHDR" {
        return Err(reader.fault("is no complete PNG image"));
    }
    let mut side = || -> Result<u64> {
        let bytes = reader.array("the PNG header")?;
        Ok(u64::from(u32::from_be_bytes(bytes)))
    };
    Ok((side()?, side()?))
}

/// JPEG after the first two bytes: segments up to the frame header.
fn jpeg(reader: &mut Reader) -> Result<(u64, u64)> {
    loop {
        let mut byte = [0];
        while byte[0] != 0xff {
            reader.fill(&mut byte, "the JPEG header")?;
        }
        // Markers may be padded with any number of 0xff.
        while byte[0] == 0xff {
            reader.fill(&mut byte, "the JPEG header")?;
        }
        match byte[0] {
            // Markers without contents.
            0x00 | 0x01 | 0xd0..=0xd8 => continue,
            0xd9 | 0xda => return Err(reader.fault("the JPEG file has no frame header")),
            marker => {
                let length = u16::from_be_bytes(reader.array("a JPEG segment")?);
                let Some(length) = length.checked_sub(2) else {
                    return Err(reader.fault("a JPEG segment has an impossible length"));
                };
                // All start-of-frame markers; the three others in that range are tables.
                if matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
                    let [_, h1, h0, w1, w0] = reader.array("the JPEG frame header")?;
                    let side = |high, low| u64::from(u16::from_be_bytes([high, low]));
                    return Ok((side(w1, w0), side(h1, h0)));
                }
                reader.skip(u64::from(length), "a JPEG segment")?;
            }
        }
    }
}

/// Most scans accepted in a JPEG file; progressive ones have about ten. A scan of a few bytes can make the decoder walk
/// the whole image, so without a limit a small file could take hours.
const SCANS_MAX: usize = 256;

/// Refuses a JPEG file that ends inside its pixels, which the decoder would fill with grey (the PNG decoder detects
/// truncation itself), and one with more than [`SCANS_MAX`] scans.
pub(super) fn check_complete(path: &Path, bytes: &[u8]) -> Result<()> {
    if !bytes.starts_with(&[0xff, 0xd8]) {
        return Ok(());
    }
    // Previews inside segments have end markers of their own: walk the segments to the first scan.
    let mut at = 2;
    while let Some(&[0xff, marker, high, low]) = bytes.get(at..at + 4) {
        if marker == 0xda {
            break;
        }
        at += match marker {
            0xff => 1,
            0x01 | 0xd0..=0xd8 => 2,
            _ => 2 + usize::from(u16::from_be_bytes([high, low])),
        };
    }
    let scans = bytes.get(at..).unwrap_or_default();
    // Inside of scans, 0xff is always followed by zero or a restart marker.
    let markers = |wanted: u8| scans.windows(2).filter(move |pair| *pair == [0xff, wanted]);
    if markers(0xd9).next().is_none() {
        return Err(Error::file(path, "is cut short: the JPEG data has no end"));
    }
    if markers(0xda).nth(SCANS_MAX).is_some() {
        let what = format!("has more than {SCANS_MAX} JPEG scans");
        return Err(Error::file(path, what));
    }
    Ok(())
}
