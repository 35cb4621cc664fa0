//! Writing codes.

use super::super::atomic::write_atomically;
use super::codes::SpzCodes;
use super::extensions;
use super::header::{ANTIALIASED, EXTENSIONS, HEADER_BYTES_V4, MAGIC};
use crate::error::Result;
use flate2::{Compression, GzBuilder};
use rayon::prelude::*;
use std::borrow::Cow;
use std::io::{self, Write};
use std::path::Path;

/// Level of zstd by default, that of the `spz` library. Higher ones gain little and take many times as long.
pub const LEVEL: i32 = 12;

/// Versions of the format that are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpzVersion {
    /// One gzip stream, of 2025: no place for axes.
    V3,
    /// A zstd frame for each attribute, of 2026; says its axes.
    #[default]
    V4,
}

/// zstd frame of an attribute.
struct Frame {
    /// Index of the attribute.
    attribute: usize,
    bytes: Vec<u8>,
    /// Length of its contents.
    inflated: usize,
}

impl SpzCodes {
    /// Writes a file atomically. `level` is that of zstd, 1 to 22, in version 4; of gzip, 0 to 9, in version 3, where
    /// higher ones count as 9. Equal codes give equal files.
    ///
    /// # Errors
    /// Those of writing the file; in version 4, axes with an x that is neither left nor right, for which
    /// there is no value.
    ///
    /// # Panics
    /// If arrays differ in length.
    pub fn write(&self, path: &Path, version: SpzVersion, level: i32) -> Result<()> {
        write_atomically(path, |file| self.write_to(file, version, level))
    }

    /// Contents of the file that [`SpzCodes::write`] writes.
    ///
    /// # Errors
    /// Axes without a value, as for [`SpzCodes::write`], and a lack of memory.
    pub fn bytes(&self, version: SpzVersion, level: i32) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.write_to(&mut bytes, version, level)?;
        Ok(bytes)
    }

    /// Compressed bytes of the attributes in version 4: positions, alphas, colours, scales, rotations, harmonics. The
    /// rest of the file is 44 bytes, and 16 for each attribute present.
    ///
    /// # Errors
    /// Those of [`SpzCodes::bytes`].
    pub fn stream_bytes(&self, level: i32) -> io::Result<[usize; 6]> {
        let mut sizes = [0; 6];
        for frame in self.frames(level)? {
            sizes[frame.attribute] = frame.bytes.len();
        }
        Ok(sizes)
    }

    /// Index and contents of the attributes with contents.
    fn streams(&self) -> Vec<(usize, Cow<'_, [u8]>)> {
        let count = self.len();
        assert_eq!(self.alpha.len(), count, "alphas of all splats");
        assert_eq!(self.color.len(), count, "colours of all splats");
        assert_eq!(self.scale.len(), count, "scales of all splats");
        assert_eq!(self.rotation.len(), count, "rotations of all splats");
        assert_eq!(self.sh.len(), count * self.sh_stride(), "harmonics");
        let low_bytes = |code: &i32| {
            let [a, b, c, _] = code.to_le_bytes();
            [a, b, c]
        };
        let position: Vec<u8> = self.position.as_flattened().iter().flat_map(low_bytes).collect();
        let rotation: Vec<u8> = self.rotation.iter().flat_map(|code| code.to_le_bytes()).collect();
        let all: [Cow<[u8]>; 6] = [
            position.into(),
            (&self.alpha).into(),
            self.color.as_flattened().into(),
            self.scale.as_flattened().into(),
            rotation.into(),
            (&self.sh).into(),
        ];
        let all = all.into_iter().enumerate();
        all.filter(|(_, stream)| !stream.is_empty()).collect()
    }

    /// Frames of the attributes with contents.
    fn frames(&self, level: i32) -> io::Result<Vec<Frame>> {
        let streams = self.streams();
        let compressed = streams.par_iter().map(|(attribute, stream)| {
            Ok(Frame {
                attribute: *attribute,
                bytes: zstd::bulk::compress(stream, level)?,
                inflated: stream.len(),
            })
        });
        compressed.collect()
    }

    fn write_to(&self, into: &mut impl Write, version: SpzVersion, level: i32) -> io::Result<()> {
        match version {
            SpzVersion::V3 => self.write_gzip(into, level),
            SpzVersion::V4 => self.write_frames(into, level),
        }
    }

    /// The 16 bytes with which the headers of all versions begin, but for the last.
    fn header(&self, version: u32, flags: u8) -> Vec<u8> {
        let count = u32::try_from(self.len()).unwrap_or(u32::MAX);
        assert_eq!(count as usize, self.len(), "more splats than the format counts");
        let flags = flags | if self.antialiased { ANTIALIASED } else { 0 };
        let mut header = MAGIC.to_vec();
        header.extend(version.to_le_bytes());
        header.extend(count.to_le_bytes());
        header.extend([self.sh_degree as u8, self.fractional_bits as u8, flags]);
        header
    }

    fn write_gzip(&self, into: &mut impl Write, level: i32) -> io::Result<()> {
        let mut header = self.header(3, 0);
        header.push(0);
        let level = Compression::new(level.clamp(0, 9) as u32);
        // Without name and time, so that the file depends on the codes only.
        let mut gzip = GzBuilder::new().write(into, level);
        gzip.write_all(&header)?;
        for (_, stream) in self.streams() {
            gzip.write_all(&stream)?;
        }
        gzip.finish().map(|_| ())
    }

    fn write_frames(&self, into: &mut impl Write, level: i32) -> io::Result<()> {
        let frames = self.frames(level)?;
        let record = extensions::record(self.axes).ok_or_else(|| {
            let what = format!("SPZ has no value for the axes {}", self.axes);
            io::Error::new(io::ErrorKind::InvalidInput, what)
        })?;
        let mut header = self.header(4, EXTENSIONS);
        header.push(frames.len() as u8);
        header.extend(((HEADER_BYTES_V4 + record.len()) as u32).to_le_bytes());
        header.resize(HEADER_BYTES_V4, 0);
        header.extend(record);
        for Frame { bytes, inflated, .. } in &frames {
            header.extend((bytes.len() as u64).to_le_bytes());
            header.extend((*inflated as u64).to_le_bytes());
        }
        into.write_all(&header)?;
        frames.iter().try_for_each(|frame| into.write_all(&frame.bytes))
    }
}
