//! Buffers of a document: the binary chunk, `data:` URIs and files beside it, each loaded when first used.

use super::super::check::{Check, inside};
use super::super::reader::{Reader, excerpt};
use super::super::source::Source;
use super::base64;
use super::json::{BufferJson, Document, entry};
use std::borrow::Cow;
use std::cell::OnceCell;
use std::path::{Path, PathBuf};

/// Most buffers of a document; each is compared with those before it.
const BUFFERS_MAX: usize = 4096;

/// Buffers of a document.
pub(super) struct Buffers<'a> {
    document: &'a Document,
    chunk: Option<&'a [u8]>,
    /// Path of each buffer that is a file; the error if its name is refused.
    paths: Vec<Option<Check<PathBuf>>>,
    loaded: Vec<OnceCell<Cow<'a, [u8]>>>,
}

/// Bytes of a buffer view, and the distance between its elements.
pub(super) struct ViewBytes<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) stride: Option<u64>,
}

impl<'a> Buffers<'a> {
    /// Buffers of a document whose binary chunk is `chunk`; without a `folder`, external files are refused.
    pub(super) fn new(document: &'a Document, chunk: Option<&'a [u8]>, folder: Option<&Path>) -> Check<Buffers<'a>> {
        let count = document.buffers.len();
        if count > BUFFERS_MAX {
            return Err(format!("has {count} buffers, more than {BUFFERS_MAX}"));
        }
        let path = |buffer: &BufferJson| {
            let uri = buffer.uri.as_ref().filter(|uri| !uri.starts_with("data:"))?;
            let Some(folder) = folder else {
                let name = excerpt(uri);
                return Some(Err(format!(
                    "its file {name} cannot be read, because the document is in memory: give a path, or a .glb"
                )));
            };
            Some(unescape(uri).and_then(|name| inside(folder, &name)))
        };
        Ok(Buffers {
            document,
            chunk,
            paths: document.buffers.iter().map(path).collect(),
            loaded: (0..count).map(|_| OnceCell::new()).collect(),
        })
    }

    /// Bytes of a buffer view.
    pub(super) fn view(&self, index: u32) -> Check<ViewBytes<'_>> {
        let view = entry(&self.document.buffer_views, index, "buffer view")?;
        let buffer = self.buffer(view.buffer)?;
        let bytes = part(buffer, view.byte_offset, view.byte_length).ok_or_else(|| {
            let (length, at, all) = (view.byte_length, view.byte_offset, buffer.len());
            format!("buffer view {index}: {length} bytes from byte {at} are not in a buffer of {all}")
        })?;
        Ok(ViewBytes {
            bytes,
            stride: view.byte_stride,
        })
    }

    fn buffer(&self, index: u32) -> Check<&[u8]> {
        let buffer = entry(&self.document.buffers, index, "buffer")?;
        let fault = |what: String| format!("buffer {index}: {what}");
        // Buffers that are the same file share its bytes.
        let path = &self.paths[index as usize];
        let first = match path {
            Some(Ok(path)) => self
                .paths
                .iter()
                .position(|p| p.as_ref().is_some_and(|p| p.as_ref() == Ok(path))),
            _ => None,
        };
        let cell = &self.loaded[first.unwrap_or(index as usize)];
        let bytes = match cell.get() {
            Some(bytes) => bytes,
            None => {
                let bytes = self.load(index, buffer, path.as_ref()).map_err(fault)?;
                cell.get_or_init(|| bytes)
            }
        };
        part(bytes, 0, buffer.byte_length).ok_or_else(|| {
            let (length, all) = (buffer.byte_length, bytes.len());
            fault(format!("has {length} bytes in the document, but {all} in fact"))
        })
    }

    fn load(&self, index: u32, buffer: &'a BufferJson, path: Option<&Check<PathBuf>>) -> Check<Cow<'a, [u8]>> {
        if let Some(path) = path {
            let path = path.as_ref().map_err(String::clone)?;
            let bytes = Reader::all(Source::from(path.as_path())).map_err(|e| e.to_string())?;
            return Ok(bytes.into_owned().into());
        }
        match (&buffer.uri, self.chunk) {
            (Some(uri), _) => {
                let data = uri.strip_prefix("data:").and_then(|data| data.split_once(','));
                let Some((kind, text)) = data.filter(|(kind, _)| kind.ends_with(";base64")) else {
                    return Err(format!("{} is no data: URI in base 64", excerpt(uri)));
                };
                let bytes = base64::decode(text).map_err(|what| format!("data: URI {}: {what}", excerpt(kind)))?;
                Ok(bytes.into())
            }
            (None, Some(chunk)) if index == 0 => Ok(chunk.into()),
            (None, _) => Err("has neither a URI nor a binary chunk".into()),
        }
    }

    /// Bytes of the external files loaded.
    pub(super) fn external_bytes(&self) -> u64 {
        let files = self.paths.iter().zip(&self.loaded).filter(|(path, _)| path.is_some());
        files
            .filter_map(|(_, cell)| cell.get())
            .map(|bytes| bytes.len() as u64)
            .sum()
    }
}

/// Part of some bytes; `None` if they do not reach that far.
pub(super) fn part(bytes: &[u8], at: u64, length: u64) -> Option<&[u8]> {
    let at = usize::try_from(at).ok()?;
    bytes.get(at..)?.get(..usize::try_from(length).ok()?)
}

/// Name in a relative URI, whose special characters are `%` and two digits of base 16.
fn unescape(uri: &str) -> Check<String> {
    let fault = || format!("{} is no name of a file", excerpt(uri));
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let (byte, after) = match (byte, after) {
            (b'%', [high, low, after @ ..]) => {
                let digit = |d: &u8| char::from(*d).to_digit(16).ok_or_else(fault);
                ((16 * digit(high)? + digit(low)?) as u8, after)
            }
            (b'%', _) => return Err(fault()),
            other => other,
        };
        bytes.push(byte);
        rest = after;
    }
    String::from_utf8(bytes).map_err(|_| fault())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unescaped() {
        assert_eq!(unescape("a%20b%C3%A9.bin").as_deref(), Ok("a bé.bin"));
        for wrong in ["%", "a%2", "%zz", "%ff"] {
            assert!(unescape(wrong).is_err(), "{wrong}");
        }
    }
}
