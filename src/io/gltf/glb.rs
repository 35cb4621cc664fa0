//! GLB container: a header and chunks, of which the first is JSON and the second may be a buffer.

use super::super::check::Check;

/// First bytes of a GLB file.
pub(super) const MAGIC: &[u8; 4] = b"glTF";

const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// Types of chunks.
pub(super) const JSON: [u8; 4] = *b"JSON";
pub(super) const BIN: [u8; 4] = *b"BIN\0";

/// JSON text of a file, and its binary chunk.
pub(super) struct GlbContainer<'a> {
    pub(super) json: &'a [u8],
    pub(super) chunk: Option<&'a [u8]>,
    /// Bytes after the length that the header states.
    pub(super) trailing: usize,
}

/// Splits a GLB file, or takes a `.gltf` file as JSON.
pub(super) fn split(file: &[u8]) -> Check<GlbContainer<'_>> {
    if file.is_empty() {
        return Err("the file is empty".into());
    }
    if !file.starts_with(MAGIC) {
        let text = file.strip_prefix(b"\xef\xbb\xbf").unwrap_or(file);
        if text.trim_ascii_start().first() != Some(&b'{') {
            return Err("is neither a GLB file (whose first bytes are \"glTF\") nor a JSON object".into());
        }
        return Ok(GlbContainer {
            json: text,
            chunk: None,
            trailing: 0,
        });
    }
    let word = |at: usize, what: &str| -> Check<u32> {
        let bytes = file.get(at..).and_then(|rest| rest.first_chunk::<4>());
        bytes
            .map(|b| u32::from_le_bytes(*b))
            .ok_or_else(|| format!("byte {at}: the file ends inside {what}"))
    };
    let version = word(4, "the version")?;
    if version != 2 {
        return Err(format!("GLB version {version} is not supported (2 is)"));
    }
    let length = word(8, "the length")? as usize;
    if length > file.len() || length < HEADER_BYTES {
        let all = file.len();
        return Err(format!("the header announces {length} bytes, but the file has {all}"));
    }
    let mut container = GlbContainer {
        json: &[],
        chunk: None,
        trailing: file.len() - length,
    };
    let mut at = HEADER_BYTES;
    let mut index = 0;
    while at < length {
        let size = word(at, "a chunk's length")? as usize;
        let kind = word(at + 4, "a chunk's type")?.to_le_bytes();
        let start = at + CHUNK_HEADER_BYTES;
        let Some(contents) = file[..length].get(start..).and_then(|rest| rest.get(..size)) else {
            let left = length.saturating_sub(start);
            return Err(format!(
                "byte {at}: chunk {index} has {size} bytes, but {left} are left"
            ));
        };
        match (index, kind) {
            (0, JSON) => container.json = contents,
            (0, _) => return Err(format!("byte {at}: the first chunk is not JSON")),
            (1, BIN) => container.chunk = Some(contents),
            // Chunks of other types are for extensions.
            _ => {}
        }
        at = start + size;
        index += 1;
    }
    match index {
        0 => Err("has no JSON chunk".into()),
        _ => Ok(container),
    }
}
