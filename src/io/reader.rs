//! Forward reader of a file, or of bytes in memory, with its size and the position of every fault.
//!
//! The formats here store counts before contents. [`Reader::check_count`] compares each with the rest of the file, so
//! that no allocation exceeds the file's capacity.

use super::source::Source;
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// A file or bytes in memory, with the length, the offset reached and, for text, the line.
pub(crate) struct Reader<'a> {
    path: &'a Path,
    input: Input<'a>,
    size: u64,
    offset: u64,
    line: u64,
}

enum Input<'a> {
    File(BufReader<File>),
    Memory(&'a [u8]),
}

impl<'a> Reader<'a> {
    /// Opens a regular file or bytes in memory.
    pub(crate) fn open(source: impl Into<Source<'a>>) -> Result<Reader<'a>> {
        let source = source.into();
        let path = source.name();
        let (input, size) = match source.in_memory() {
            Some(bytes) => (Input::Memory(bytes), bytes.len() as u64),
            None => {
                let file = File::open(path).map_err(Error::io(path))?;
                let meta = file.metadata().map_err(Error::io(path))?;
                if !meta.is_file() {
                    return Err(Error::file(path, "is not a file"));
                }
                let file = BufReader::with_capacity(1 << 16, file);
                (Input::File(file), meta.len())
            }
        };
        Ok(Reader {
            path,
            input,
            size,
            offset: 0,
            line: 0,
        })
    }

    /// The whole source, up to its size when opened: a file may grow while it is read.
    pub(crate) fn all(source: Source<'a>) -> Result<std::borrow::Cow<'a, [u8]>> {
        if let Some(bytes) = source.in_memory() {
            return Ok(bytes.into());
        }
        let mut reader = Reader::open(source)?;
        let length = reader.check_count(reader.size, 1, "bytes")?;
        let mut bytes = vec![0; length];
        reader.fill(&mut bytes, "the file")?;
        Ok(bytes.into())
    }

    /// Path of the file, or name of the bytes in memory.
    pub(crate) fn path(&self) -> &'a Path {
        self.path
    }

    /// Length of the file in bytes.
    pub(crate) fn size(&self) -> u64 {
        self.size
    }

    /// Bytes read so far.
    pub(crate) fn offset(&self) -> u64 {
        self.offset
    }

    /// Bytes left.
    pub(crate) fn remaining(&self) -> u64 {
        self.size.saturating_sub(self.offset)
    }

    /// Number of the line read last, from 1.
    #[cfg(feature = "train")]
    pub(crate) fn line_number(&self) -> u64 {
        self.line
    }

    /// Error at the current byte.
    pub(crate) fn fault(&self, what: impl AsRef<str>) -> Error {
        Error::file(self.path, format!("byte {}: {}", self.offset, what.as_ref()))
    }

    /// Error in the last line read.
    pub(crate) fn fault_in_line(&self, what: impl AsRef<str>) -> Error {
        Error::file(self.path, format!("line {}: {}", self.line, what.as_ref()))
    }

    /// Fills `into`; `what` names the contents in the message if the file ends early.
    pub(crate) fn fill(&mut self, into: &mut [u8], what: &str) -> Result<()> {
        if (into.len() as u64) > self.remaining() {
            return Err(self.fault(format!(
                "the file ends inside {what} ({} bytes expected, {} left)",
                into.len(),
                self.remaining()
            )));
        }
        let read = match &mut self.input {
            Input::File(file) => file.read_exact(into),
            Input::Memory(bytes) => bytes.read_exact(into),
        };
        read.map_err(Error::io(self.path))?;
        self.offset += into.len() as u64;
        Ok(())
    }

    /// The next `N` bytes.
    pub(crate) fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.fill(&mut bytes, what)?;
        Ok(bytes)
    }

    /// A little-endian `u32`.
    pub(crate) fn u32(&mut self, what: &str) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    /// A little-endian `u64`.
    #[cfg(feature = "train")]
    pub(crate) fn u64(&mut self, what: &str) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    /// Consecutive little-endian doubles.
    #[cfg(feature = "train")]
    pub(crate) fn f64s<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f64::from_le_bytes(self.array(what)?);
        }
        Ok(values)
    }

    /// Compares `count` items of at least `bytes_each` bytes with the rest of the file.
    pub(crate) fn check_count(&self, count: u64, bytes_each: u64, what: &str) -> Result<usize> {
        let fits = count
            .checked_mul(bytes_each)
            .is_some_and(|bytes| bytes <= self.remaining());
        match usize::try_from(count) {
            Ok(count) if fits => Ok(count),
            _ => Err(self.fault(format!(
                "{count} {what} of at least {bytes_each} bytes are announced, but the file has \
                 only {} bytes left",
                self.remaining()
            ))),
        }
    }

    /// Skips bytes; an error if the file ends before.
    pub(crate) fn skip(&mut self, bytes: u64, what: &str) -> Result<()> {
        if bytes > self.remaining() {
            return Err(self.fault(format!(
                "the file ends inside {what} ({bytes} bytes expected, {} left)",
                self.remaining()
            )));
        }
        let step = i64::try_from(bytes).map_err(|_| self.fault(format!("{what} is too long")))?;
        match &mut self.input {
            Input::File(file) => file.seek_relative(step).map_err(Error::io(self.path))?,
            // In bounds: `bytes` is at most `remaining`.
            Input::Memory(left) => *left = &left[bytes as usize..],
        }
        self.offset += bytes;
        Ok(())
    }

    /// Bytes up to a zero byte, which is consumed; at most `limit`.
    #[cfg(feature = "train")]
    pub(crate) fn zero_terminated(&mut self, limit: u64, what: &str) -> Result<Vec<u8>> {
        let bytes = self.until(0, limit)?;
        match bytes.split_last() {
            Some((0, text)) => Ok(text.to_vec()),
            _ => Err(self.fault(format!("{what} has no end (a zero byte within {limit})"))),
        }
    }

    /// The next line without its end (LF or CR LF) in `into`; false at the end of the file.
    pub(crate) fn line(&mut self, into: &mut String, limit: u64) -> Result<bool> {
        let mut bytes = self.until(b'\n', limit)?;
        self.line += 1;
        if bytes.is_empty() {
            into.clear();
            return Ok(false);
        }
        match bytes.last() {
            Some(b'\n') => _ = bytes.pop(),
            _ if bytes.len() as u64 >= limit => {
                return Err(self.fault_in_line(format!("longer than {limit} bytes")));
            }
            _ => {}
        }
        if bytes.last() == Some(&b'\r') {
            bytes.pop();
        }
        *into = String::from_utf8(bytes).map_err(|_| self.fault_in_line("is not UTF-8 text"))?;
        Ok(true)
    }

    fn until(&mut self, end: u8, limit: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let read = match &mut self.input {
            Input::File(file) => file.take(limit).read_until(end, &mut bytes),
            Input::Memory(left) => left.take(limit).read_until(end, &mut bytes),
        };
        read.map_err(Error::io(self.path))?;
        self.offset += bytes.len() as u64;
        Ok(bytes)
    }
}

/// Number in Rust's grammar, or a NaN of C libraries such as `-nan(ind)`.
pub(crate) fn parse_number(token: &str) -> Option<f64> {
    token.parse().ok().or_else(|| {
        let word = token.trim_start_matches(['-', '+']).to_ascii_lowercase();
        (word.starts_with("nan") || word.contains("#ind") || word.contains("#qnan"))
            .then_some(f64::NAN)
            .or_else(|| word.contains("#inf").then_some(f64::INFINITY))
    })
}

/// At most 60 characters of untrusted text, quoted for a message.
pub(crate) fn excerpt(text: &str) -> String {
    let short: String = text.chars().take(60).collect();
    let more = if short.len() < text.len() { "…" } else { "" };
    format!("{short:?}{more}")
}
