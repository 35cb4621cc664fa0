//! Container of named arrays with a description and checksums.
//!
//! ```text
//! 8 bytes   magic "ASHFALL\x1a"
//! u32       version (2)
//! u32       bytes of the header
//! u32       CRC-32 of the header
//! …         the header: JSON { "meta": …, "sections": [{ "name", "dtype", "bytes", "crc32" }, …] }
//! …         the sections one after another, little-endian, to the end of the file
//! ```
//!
//! The meaning of the sections is left to the writer. The header is checked when a file is opened, each section when it
//! is read; the lengths must add up to the size of the file exactly, so a truncated file is detected before anything is
//! allocated for it.

use super::atomic::write_atomically;
use super::reader::Reader;
use super::source::Source;
use crate::error::{Error, Result};
use bytemuck::Pod;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::io::Write;
use std::path::Path;

const MAGIC: [u8; 8] = *b"ASHFALL\x1a";
const VERSION: u32 = 2;

/// Longest header accepted in bytes; a trainer's has some kilobytes.
const HEADER_BYTES_MAX: u32 = 1 << 24;

// Arrays are copied in native byte order.
const _: () = assert!(cfg!(target_endian = "little"));

/// Number type of a section.
pub trait Element: Pod {
    /// Name of the type in the file.
    const DTYPE: &'static str;
}

impl Element for u8 {
    const DTYPE: &'static str = "u8";
}
impl Element for u32 {
    const DTYPE: &'static str = "u32";
}
impl Element for u64 {
    const DTYPE: &'static str = "u64";
}
impl Element for f32 {
    const DTYPE: &'static str = "f32";
}
impl Element for f64 {
    const DTYPE: &'static str = "f64";
}

/// A named array to be written.
#[derive(Clone, Copy, Debug)]
pub struct Section<'a> {
    name: &'a str,
    dtype: &'static str,
    bytes: &'a [u8],
}

impl<'a> Section<'a> {
    /// An array with a name that is unique in the file.
    pub fn new<T: Element>(name: &'a str, values: &'a [T]) -> Section<'a> {
        Section {
            name,
            dtype: T::DTYPE,
            bytes: bytemuck::cast_slice(values),
        }
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct Header {
    meta: Value,
    sections: Vec<Entry>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Entry {
    name: String,
    dtype: String,
    bytes: u64,
    crc32: u32,
}

/// Writes `meta` (any JSON) and the sections, atomically.
pub fn write(path: &Path, meta: &Value, sections: &[Section<'_>]) -> Result<()> {
    let entries: Vec<Entry> = sections
        .iter()
        .map(|section| Entry {
            name: section.name.to_owned(),
            dtype: section.dtype.to_owned(),
            bytes: section.bytes.len() as u64,
            crc32: crc32fast::hash(section.bytes),
        })
        .collect();
    for (i, entry) in entries.iter().enumerate() {
        let twice = entries[..i].iter().any(|other| other.name == entry.name);
        assert!(!twice, "two sections are named {:?}", entry.name);
    }
    let header = Header {
        meta: meta.clone(),
        sections: entries,
    };
    write_atomically(path, |file| {
        let header = serde_json::to_vec(&header)?;
        let length = u32::try_from(header.len()).unwrap_or(u32::MAX);
        if length > HEADER_BYTES_MAX {
            return Err(std::io::Error::other("the checkpoint's header is too long"));
        }
        file.write_all(&MAGIC)?;
        file.write_all(&VERSION.to_le_bytes())?;
        file.write_all(&length.to_le_bytes())?;
        file.write_all(&crc32fast::hash(&header).to_le_bytes())?;
        file.write_all(&header)?;
        sections.iter().try_for_each(|s| file.write_all(s.bytes))
    })
}

/// An opened file: the header is read and checked, the sections are still on the disk.
#[derive(Debug)]
pub struct Checkpoint<'a> {
    source: Source<'a>,
    header: Header,
    /// Offset of the first section in bytes.
    start: u64,
}

impl<'a> Checkpoint<'a> {
    /// Opens a file and checks that its parts add up to its size.
    pub fn open(source: impl Into<Source<'a>>) -> Result<Checkpoint<'a>> {
        let source = source.into();
        let path = source.name();
        let mut reader = Reader::open(source)?;
        if reader.array::<8>("the magic")? != MAGIC {
            return Err(Error::file(path, "is no ashfall checkpoint (wrong magic)"));
        }
        let version = reader.u32("the version")?;
        if version != VERSION {
            let what = format!("checkpoint version {version}; this program reads {VERSION}");
            return Err(Error::file(path, what));
        }
        let length = reader.u32("the header's length")?;
        let crc = reader.u32("the header's checksum")?;
        if length > HEADER_BYTES_MAX {
            return Err(reader.fault(format!("a header of {length} bytes is announced")));
        }
        let length = reader.check_count(u64::from(length), 1, "header bytes")?;
        let mut text = vec![0; length];
        reader.fill(&mut text, "the header")?;
        if crc32fast::hash(&text) != crc {
            return Err(reader.fault("the checksum of the header is wrong: the file is damaged"));
        }
        let header: Header =
            serde_json::from_slice(&text).map_err(|e| reader.fault(format!("the header cannot be parsed: {e}")))?;
        let total = header
            .sections
            .iter()
            .try_fold(0u64, |sum, section| sum.checked_add(section.bytes));
        if total != Some(reader.remaining()) {
            return Err(reader.fault(format!(
                "the header announces {} bytes of sections, the file has {}",
                total.map_or("too many".to_owned(), |t| t.to_string()),
                reader.remaining()
            )));
        }
        Ok(Checkpoint {
            source,
            start: reader.offset(),
            header,
        })
    }

    /// Metadata given to [`write()`].
    pub fn meta(&self) -> &Value {
        &self.header.meta
    }

    /// True if a section of that name exists.
    pub fn has(&self, name: &str) -> bool {
        self.header.sections.iter().any(|s| s.name == name)
    }

    /// Names of the sections in file order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.header.sections.iter().map(|s| s.name.as_str())
    }

    /// Reads and checks a section.
    ///
    /// # Errors
    /// Names the file, the section and the offset: absent, of another type, or damaged.
    pub fn read<T: Element>(&self, name: &str) -> Result<Vec<T>> {
        let mut offset = self.start;
        for entry in &self.header.sections {
            if entry.name == name {
                return self.read_at(entry, offset);
            }
            offset += entry.bytes;
        }
        let what = format!("the checkpoint has no section {name:?}");
        Err(Error::file(self.source.name(), what))
    }

    fn read_at<T: Element>(&self, entry: &Entry, offset: u64) -> Result<Vec<T>> {
        let name = &entry.name;
        let item = size_of::<T>() as u64;
        if entry.dtype != T::DTYPE || !entry.bytes.is_multiple_of(item) {
            let what = format!(
                "section {name:?} holds {} bytes of {}, not {}",
                entry.bytes,
                entry.dtype,
                T::DTYPE
            );
            return Err(Error::file(self.source.name(), what));
        }
        let mut reader = Reader::open(self.source)?;
        let what = format!("section {name:?}");
        reader.skip(offset, &what)?;
        // The file may have changed since it was opened.
        let count = reader.check_count(entry.bytes / item, item, &format!("items of {what}"))?;
        let mut values = vec![T::zeroed(); count];
        reader.fill(bytemuck::cast_slice_mut(&mut values), &what)?;
        if crc32fast::hash(bytemuck::cast_slice(&values)) != entry.crc32 {
            let what = format!("byte {offset}: the checksum of {what} is wrong: the file is damaged");
            return Err(Error::file(self.source.name(), what));
        }
        Ok(values)
    }
}
