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

/// Packs the files of a ZIP archive again, as they follow their local headers, with fitting lengths and checksums.
pub(crate) fn zip(bytes: &mut Vec<u8>) {
    const LOCAL: &[u8] = b"PK\x03\x04";
    let starts = |signature: &[u8]| {
        let windows = bytes.windows(4).enumerate();
        let found = windows.filter(|(_, window)| *window == signature);
        found.map(|(at, _)| at).collect::<Vec<usize>>()
    };
    let headers = starts(LOCAL);
    let end = starts(b"PK\x01\x02").into_iter().find(|end| Some(end) > headers.last());
    let ends = headers.iter().skip(1).copied().chain([end.unwrap_or(bytes.len())]);
    let (mut files, mut directory) = (Vec::<u8>::new(), Vec::<u8>::new());
    let mut count = 0u16;
    for (start, end) in headers.iter().zip(ends) {
        let entry = &bytes[*start..end];
        let Some((head, rest)) = entry.split_first_chunk::<30>() else {
            continue;
        };
        let length = |at: usize| usize::from(u16::from_le_bytes([head[at], head[at + 1]]));
        let (name, rest) = rest.split_at(length(26).min(rest.len()));
        let contents = &rest[length(28).min(rest.len())..];
        let size = (contents.len() as u32).to_le_bytes();
        // Version, no flags, stored, no time, checksum, both lengths, length of the name, no more.
        let fields = [
            &[20, 0, 0, 0, 0, 0, 0, 0, 0, 0][..],
            &crc32fast::hash(contents).to_le_bytes(),
            &size,
            &size,
            &(name.len() as u16).to_le_bytes(),
            &[0, 0],
        ]
        .concat();
        let offset = files.len() as u32;
        [LOCAL, &fields, name, contents]
            .iter()
            .for_each(|part| files.extend(*part));
        [b"PK\x01\x02\x14\0", &fields[..], &[0; 10], &offset.to_le_bytes(), name]
            .iter()
            .for_each(|part| directory.extend(*part));
        count += 1;
    }
    let offset = files.len() as u32;
    let size = directory.len() as u32;
    files.extend(directory);
    files.extend(b"PK\x05\x06\0\0\0\0");
    [count; 2].iter().for_each(|count| files.extend(count.to_le_bytes()));
    [size, offset]
        .iter()
        .for_each(|number| files.extend(number.to_le_bytes()));
    files.extend([0; 2]);
    *bytes = files;
}

/// Upper bound of memory for a SOG bundle by the sizes of its images, of which those above 2²⁰ pixels are refused
/// unread. 32 bytes a pixel: four during decoding, four as the decoder returns them and four as codes, and twelve of a
/// palette's harmonics; in PNG images 24 (see [`photo_bytes`]). 256 bytes a splat of degree 3, of which there are no
/// more than pixels in an image, and than 65,536 and four for each byte. 600 for each byte: Huffman tables of four
/// kilobytes take eleven bytes in a file.
pub(crate) fn sog_bytes(bytes: &[u8]) -> usize {
    let sizes = (0..bytes.len()).filter_map(|at| {
        let rest = &bytes[at..];
        let (width, height) = match rest {
            [b'V', b'P', b'8', b'L', _, _, _, _, _, a, b, c, d, ..] => {
                let size = u32::from_le_bytes([*a, *b, *c, *d]);
                ((size & 0x3fff) + 1, (size >> 14 & 0x3fff) + 1)
            }
            [b'I', b'H', b'D', b'R', a, b, c, d, e, f, g, h, ..] => (
                u32::from_be_bytes([*a, *b, *c, *d]),
                u32::from_be_bytes([*e, *f, *g, *h]),
            ),
            _ => return None,
        };
        let pixels = u64::from(width) * u64::from(height);
        (pixels <= 1 << 20).then_some(pixels as usize)
    });
    let (sum, largest) = sizes.fold((0, 0), |(sum, largest), size| (sum + size, size.max(largest)));
    32 * sum + 256 * largest.min((1 << 16) + 4 * bytes.len()) + 600 * bytes.len()
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
