//! Splitting of inputs into files, and repair of checksums after a mutation.

use serde_json::Value;
use std::io::{Read, Write};

/// Splits an input into three files, after the lengths of the first two as 16-bit numbers.
pub(crate) fn parts_by_length(bytes: &[u8]) -> [&[u8]; 3] {
    let Some((head, rest)) = bytes.split_first_chunk::<4>() else {
        return [bytes, &[], &[]];
    };
    let [a, b, c, d] = *head;
    let length = |low, high| usize::from(u16::from_le_bytes([low, high]));
    let (first, rest) = rest.split_at(length(a, b).min(rest.len()));
    let (second, third) = rest.split_at(length(c, d).min(rest.len()));
    [first, second, third]
}

/// Splits an input into three files at the control character "record separator".
pub(crate) fn parts_by_separator(bytes: &[u8]) -> [&[u8]; 3] {
    let mut parts = bytes.splitn(3, |byte| *byte == 0x1e);
    [(); 3].map(|()| parts.next().unwrap_or_default())
}

const PREFIX: usize = 20;

/// Repairs length and checksum of a checkpoint's header, and those of its sections.
pub(crate) fn checkpoint(bytes: &mut Vec<u8>) {
    let Some(header) = bytes.get(PREFIX..) else {
        return;
    };
    // The header is the JSON value after the prefix, of any length.
    let mut values = serde_json::Deserializer::from_slice(header).into_iter::<Value>();
    let Some(Ok(mut value)) = values.next() else {
        return;
    };
    let mut sections = &header[values.byte_offset()..];
    let Some(Value::Array(entries)) = value.get_mut("sections") else {
        return;
    };
    for section in entries.iter_mut().filter_map(Value::as_object_mut) {
        let Some(length) = section.get("bytes").and_then(Value::as_u64) else {
            continue;
        };
        let length = sections.len().min(usize::try_from(length).unwrap_or(usize::MAX));
        let (own, rest) = sections.split_at(length);
        section.insert("crc32".into(), crc32fast::hash(own).into());
        sections = rest;
    }
    let end = PREFIX + values.byte_offset();
    let text = value.to_string().into_bytes();
    let crc = crc32fast::hash(&text).to_le_bytes();
    bytes[12..16].copy_from_slice(&(text.len() as u32).to_le_bytes());
    bytes[16..PREFIX].copy_from_slice(&crc);
    bytes.splice(PREFIX..end, text);
}

/// Repairs the lengths of a GLB file: the JSON chunk ends with its value, and the binary one with the file.
pub(crate) fn glb(bytes: &mut Vec<u8>) {
    const START: usize = 20;
    let Some(text) = bytes.get(START..).filter(|_| bytes.starts_with(b"glTF")) else {
        return;
    };
    let mut values = serde_json::Deserializer::from_slice(text).into_iter::<Value>();
    let Some(Ok(_)) = values.next() else {
        return;
    };
    let mut end = values.byte_offset();
    end += text[end..].iter().take_while(|byte| **byte == b' ').count();
    let put =
        |bytes: &mut Vec<u8>, at: usize, value: usize| bytes[at..at + 4].copy_from_slice(&(value as u32).to_le_bytes());
    let length = bytes.len();
    put(bytes, 8, length);
    put(bytes, 12, end);
    let binary = START + end;
    if length >= binary + 8 {
        put(bytes, binary, length - binary - 8);
    }
}

/// Upper bound of memory for a glTF file. A splat of degree 3 is 236 bytes, and 4 while an origin is sought; there is
/// at most one for each byte. An empty object in a list is three bytes, and 64 in memory, thrice while the list grows.
/// An SPZ file in it takes its own bound and is copied once.
pub(crate) fn glb_bytes(bytes: &[u8]) -> usize {
    let holds = |part: &[u8]| bytes.windows(part.len()).any(|window| window == part);
    // Beginnings of a gzip stream and of version 4, as they are and in base 64.
    let payload = if holds(b"NGSP\x04\0\0\0") || holds(b"TkdTUAQAAA") {
        spz_bytes(b"NGSP\x04\0\0\0") / 8
    } else if holds(b"\x1f\x8b") || holds(b"H4s") {
        spz_bytes(b"\x1f\x8b") / 2
    } else {
        spz_bytes(b"-")
    };
    (512 + 2 * payload) * bytes.len()
}

/// Repairs the checksums of a PNG file's chunks.
pub(crate) fn png(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(&[a, b, c, d]) = bytes.get(at..at + 4) {
        let length = u32::from_be_bytes([a, b, c, d]) as usize;
        let (start, end) = (at + 4, at.saturating_add(8).saturating_add(length));
        let (Some(chunk), true) = (bytes.get(start..end), bytes.len() >= end.saturating_add(4)) else {
            return;
        };
        let crc = crc32fast::hash(chunk).to_be_bytes();
        bytes[end..end + 4].copy_from_slice(&crc);
        at = end + 4;
    }
}

/// Upper bound of memory for a photograph's pixels, by the size in its header, if its file can hold that many: a byte
/// of a PNG file expands to at most 1,032 bytes (deflate), of eight pixels each; every 64 pixels of a JPEG file are at
/// least one bit. 24 bytes a pixel: four as 8-bit and eight as 16-bit RGBA, and those once more during conversion, for
/// decoders that also keep rows or coefficients.
pub(crate) fn photo_bytes(bytes: &[u8]) -> usize {
    let name = std::path::Path::new("photo");
    let size = ashfall::io::photo::dimensions(ashfall::io::Source::bytes(name, bytes));
    let pixels = size.map_or(0, |(width, height)| width as usize * height as usize);
    let per_byte = if bytes.starts_with(b"\x89P") { 8 * 1032 } else { 512 };
    assert!(
        pixels <= per_byte * bytes.len(),
        "{pixels} pixels in {} bytes",
        bytes.len()
    );
    24 * pixels + 64 * bytes.len()
}

/// Bytes of each attribute of all splats that the header of an SPZ file states, if they are few.
fn spz_sizes(header: &[u8]) -> Option<[usize; 6]> {
    let &[version, 0, 0, 0, low, high, 0, 0, degree, ..] = header.get(4..)? else {
        return None;
    };
    let count = usize::from(u16::from_le_bytes([low, high]));
    let position = if version == 1 { 6 } else { 9 };
    let rotation = if version < 3 { 3 } else { 4 };
    let sh = 3 * ((usize::from(degree) + 1).pow(2) - 1);
    let sizes = [position, 1, 3, 3, rotation, sh].map(|width| width * count);
    (degree < 5 && count < 64).then_some(sizes)
}

/// Makes streams of an SPZ file that have been damaged whole again: those of version 4 are inflated as far as they go,
/// padded to their sizes and compressed with a new table; a gzip stream is compressed from as much as it inflates to.
pub(crate) fn spz(bytes: &mut Vec<u8>) {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        let mut contents = Vec::new();
        let body = bytes.get(10..).unwrap_or_default();
        // As far as it goes.
        _ = flate2::read::DeflateDecoder::new(body)
            .take(8192)
            .read_to_end(&mut contents);
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(&contents).unwrap();
        *bytes = encoder.finish().unwrap();
    } else if bytes.starts_with(b"NGSP\x04\0\0\0") && bytes.len() >= 32 {
        spz_frames(bytes);
    }
}

fn spz_frames(bytes: &mut Vec<u8>) {
    let Some(sizes) = spz_sizes(bytes) else { return };
    let sizes: Vec<usize> = sizes.into_iter().filter(|size| *size > 0).collect();
    let table_at = usize::from(u16::from_le_bytes([bytes[16], bytes[17]]));
    if !(32..=bytes.len()).contains(&table_at) {
        return;
    }
    let streams = usize::from(bytes[15]).min((bytes.len() - table_at) / 16);
    let (mut left, entries) = (&bytes[table_at + 16 * streams..], &bytes[table_at..]);
    let mut frames = Vec::new();
    let mut table = Vec::new();
    for (i, &size) in sizes.iter().enumerate() {
        let entry = entries.get(16 * i..16 * i + 2).filter(|_| i < streams);
        let length = entry.map_or(0, |e| usize::from(u16::from_le_bytes([e[0], e[1]])));
        let (frame, rest) = left.split_at(length.min(left.len()));
        left = rest;
        let mut contents = Vec::new();
        if let Ok(decoder) = zstd::stream::read::Decoder::new(frame) {
            _ = decoder.take(size as u64).read_to_end(&mut contents);
        }
        contents.resize(size, 0x55);
        let frame = zstd::bulk::compress(&contents, 1).unwrap();
        table.extend((frame.len() as u64).to_le_bytes());
        table.extend((size as u64).to_le_bytes());
        frames.extend(frame);
    }
    bytes.truncate(table_at);
    bytes[15] = sizes.len() as u8;
    bytes.extend(table);
    bytes.extend(frames);
}

/// Upper bound of memory for an SPZ file. Splats take less than five times the bytes of their codes (degree 0: 56 for
/// 16), and growing arrays of codes up to three times. A byte of gzip inflates to 1,032 at most; in version 4 the
/// reader takes 1,024 / 9 splats of at most 92 bytes for each byte of the file.
pub(crate) fn spz_bytes(bytes: &[u8]) -> usize {
    let ratio = match bytes {
        [0x1f, 0x8b, ..] => 1032,
        [b'N', b'G', b'S', b'P', 4, 0, 0, 0, ..] => 1024 * 92 / 9,
        _ => 1,
    };
    (3 + 5) * ratio * bytes.len() + bytes.len()
}

/// A `.ksplat` file of its header and section headers without their long unused ends.
pub(crate) fn ksplat(bytes: &[u8]) -> Vec<u8> {
    const USED: usize = 44;
    let Some((header, mut left)) = bytes.split_at_checked(USED) else {
        return bytes.to_vec();
    };
    let mut whole = header.to_vec();
    whole.resize(4096, 0);
    for _ in 0..header[4].min(8) {
        let (section, rest) = left.split_at(USED.min(left.len()));
        let end = whole.len() + 1024;
        whole.extend(section);
        whole.resize(end, 0);
        left = rest;
    }
    whole.extend(left);
    whole
}
