//! Source of a reader's bytes: a file, or memory under a name.

use std::path::{Path, PathBuf};

/// A file to be read, or its contents in memory under a name used in messages.
///
/// Every reader takes `impl Into<Source>`, so a path works:
///
/// ```
/// use ashfall::io::{Source, ply};
///
/// let fault = ply::read(Source::bytes("scene.ply".as_ref(), b"plz"));
/// assert!(fault.is_err_and(|e| e.to_string().starts_with("scene.ply: byte 0: not a PLY file")));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    name: &'a Path,
    bytes: Option<&'a [u8]>,
}

impl<'a> Source<'a> {
    /// Contents in memory; no file `name` needs to exist.
    pub fn bytes(name: &'a Path, bytes: &'a [u8]) -> Source<'a> {
        Source {
            name,
            bytes: Some(bytes),
        }
    }

    /// Path of the file, or name of the bytes in memory.
    pub fn name(&self) -> &'a Path {
        self.name
    }

    /// Bytes in memory; `None` for a file.
    pub(super) fn in_memory(&self) -> Option<&'a [u8]> {
        self.bytes
    }
}

impl<'a> From<&'a Path> for Source<'a> {
    fn from(name: &'a Path) -> Source<'a> {
        Source { name, bytes: None }
    }
}

impl<'a> From<&'a PathBuf> for Source<'a> {
    fn from(name: &'a PathBuf) -> Source<'a> {
        Source::from(name.as_path())
    }
}
