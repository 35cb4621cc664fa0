//! Header of all versions, and the sizes that follow from it.

use crate::error::{Error, Result};
use crate::scene::sh_coefficient_count;
use std::path::Path;

/// First bytes of version 4, and of the contents of the gzip stream before it.
pub(super) const MAGIC: [u8; 4] = *b"NGSP";
/// Bytes of the header of versions 1 to 3, and of version 4.
pub(super) const HEADER_BYTES: usize = 16;
pub(super) const HEADER_BYTES_V4: usize = 32;

/// Rendering with the mip filter.
pub(super) const ANTIALIASED: u8 = 1;
/// Extension records are present.
pub(super) const EXTENSIONS: u8 = 2;
/// Tree of levels of detail by Spark, after the harmonics.
pub(super) const SPARK_TREE: u8 = 0x80;

/// Attributes in the order of the file.
pub(super) const ATTRIBUTES: [&str; 6] = ["positions", "alphas", "colours", "scales", "rotations", "harmonics"];

/// Largest number of fractional bits: positions have 24 bits.
pub(super) const FRACTIONAL_BITS_MAX: u32 = 24;

/// Properties of all splats.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpzHeader {
    pub(super) version: u32,
    pub(super) count: u64,
    /// 0 to 4.
    pub(super) sh_degree: u32,
    pub(super) fractional_bits: u32,
    pub(super) flags: u8,
}

impl SpzHeader {
    /// Parses the first 16 bytes, the same in all versions; `place` tells where they are.
    pub(super) fn parse(path: &Path, bytes: &[u8; HEADER_BYTES], place: &str) -> Result<SpzHeader> {
        let fault = |what: String| Err(Error::file(path, format!("{place}: {what}")));
        let [a, b, c, d, rest @ ..] = *bytes;
        if [a, b, c, d] != MAGIC {
            let magic = String::from_utf8_lossy(&[a, b, c, d]).into_owned();
            return fault(format!(
                "begins with {magic:?} in place of \"NGSP\", so it is no SPZ scene"
            ));
        }
        let [a, b, c, d, e, f, g, h, degree, bits, flags, _reserved] = rest;
        let header = SpzHeader {
            version: u32::from_le_bytes([a, b, c, d]),
            count: u32::from_le_bytes([e, f, g, h]).into(),
            sh_degree: degree.into(),
            fractional_bits: bits.into(),
            flags,
        };
        if !(1..=4).contains(&header.version) {
            return fault(format!("SPZ version {} is not known; 1 to 4 are", header.version));
        }
        if header.sh_degree > 4 {
            return fault(format!("SH degree {degree}; 0 to 4 are possible"));
        }
        if header.fractional_bits > FRACTIONAL_BITS_MAX {
            return fault(format!(
                "positions with {bits} fractional bits; at most {FRACTIONAL_BITS_MAX} are possible"
            ));
        }
        Ok(header)
    }

    /// Bytes of each attribute of a splat, in the order of [`ATTRIBUTES`].
    pub(super) fn widths(&self) -> [u64; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version < 3 { 3 } else { 4 };
        let sh = 3 * (sh_coefficient_count(self.sh_degree) - 1);
        [position, 1, 3, 3, rotation, sh as u64]
    }

    /// Bytes of each attribute of all splats.
    pub(super) fn sizes(&self) -> [u64; 6] {
        self.widths().map(|width| width * self.count)
    }

    /// Warnings about flags and bands that are ignored.
    pub(super) fn warnings(&self, path: &Path) -> Vec<String> {
        let path = path.display();
        let mut warnings = Vec::new();
        if self.sh_degree == 4 {
            warnings.push(format!("{path}: the harmonics of degree 4 were left out"));
        }
        if self.flags & SPARK_TREE != 0 {
            warnings.push(format!(
                "{path}: the tree of levels of detail (flag 0x80) was ignored; its splats may be too opaque"
            ));
        }
        let unknown = self.flags & !(ANTIALIASED | EXTENSIONS | SPARK_TREE);
        if unknown != 0 {
            warnings.push(format!("{path}: the unknown flags {unknown:#04x} were ignored"));
        }
        warnings
    }
}
