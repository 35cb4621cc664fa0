//! Splitting of inputs into files, and repair of checksums after a mutation.

use serde_json::Value;

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
