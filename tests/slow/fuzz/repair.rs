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
