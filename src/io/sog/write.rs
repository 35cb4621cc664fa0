//! Writing of version 2 bundles.

use super::super::atomic::write_atomically;
use super::archive::META;
use super::codes::{SogCodes, SogPalette};
use super::meta::{NAMES, text};
use super::textures::{SIDE_MAX, encode};
use crate::error::{Error, Result};
use rayon::prelude::*;
use std::io::{Cursor, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// Entries in a row of the palette's image.
const ENTRIES_WIDTH: usize = 64;

/// An image not yet encoded.
struct Plane {
    width: usize,
    height: usize,
    rgba: Vec<[u8; 4]>,
}

impl SogCodes {
    /// The bundle: a ZIP archive of `meta.json` and then the images, all stored, the same bytes for the same codes.
    ///
    /// # Errors
    /// The scene exceeds the largest image of the format (2²⁸ splats).
    pub fn bytes(&self) -> Result<Vec<u8>> {
        let unsupported = |what: String| Error::Unsupported { what };
        if self.len() > SIDE_MAX.pow(2) - 8 * SIDE_MAX {
            return Err(unsupported(format!("{} splats in a SOG file", self.len())));
        }
        let images = self.planes().into_par_iter().map(|plane| {
            let image = encode(&plane.rgba, plane.width, plane.height);
            image.map_err(unsupported)
        });
        let images: Vec<Vec<u8>> = images.collect::<Result<_>>()?;
        let packed = archive(&text(self), &images);
        packed.map_err(|e| unsupported(format!("a ZIP archive of this scene: {e}")))
    }

    /// Writes the bundle, atomically.
    ///
    /// # Errors
    /// Those of [`bytes`](SogCodes::bytes); the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let bytes = self.bytes()?;
        write_atomically(path, |file| file.write_all(&bytes))
    }

    /// Images in the order of [`NAMES`].
    fn planes(&self) -> Vec<Plane> {
        let count = self.len();
        let mut planes = vec![
            plane(count, |i| mean_bytes(self.mean[i], 0)),
            plane(count, |i| mean_bytes(self.mean[i], 1)),
            plane(count, |i| self.quaternion[i]),
            plane(count, |i| opaque(self.scale[i])),
            plane(count, |i| self.color[i]),
        ];
        if let Some(palette) = &self.palette {
            planes.push(palette_plane(palette));
            planes.push(plane(count, |i| {
                let [low, high] = palette.labels[i].to_le_bytes();
                [low, high, 0, 255]
            }));
        }
        planes
    }
}

/// Low (0) or high (1) bytes of a mean.
fn mean_bytes(codes: [u16; 3], byte: usize) -> [u8; 4] {
    opaque(codes.map(|code| code.to_le_bytes()[byte]))
}

fn opaque([r, g, b]: [u8; 3]) -> [u8; 4] {
    [r, g, b, 255]
}

/// Image of a texel for each splat, row by row; sides are multiples of four, as those of other writers.
fn plane(count: usize, texel: impl Fn(usize) -> [u8; 4]) -> Plane {
    let width = 4 * ((count as f64).sqrt() / 4.0).ceil().max(1.0) as usize;
    let height = 4 * count.div_ceil(width).div_ceil(4).max(1);
    let mut rgba: Vec<[u8; 4]> = (0..count).map(texel).collect();
    // The last texel repeated costs least.
    rgba.resize(width * height, rgba.last().copied().unwrap_or([0, 0, 0, 255]));
    Plane { width, height, rgba }
}

fn palette_plane(palette: &SogPalette) -> Plane {
    let coefficients = palette.entry_length() / 3;
    let width = ENTRIES_WIDTH * coefficients;
    let height = palette.entries().div_ceil(ENTRIES_WIDTH).max(1);
    let mut rgba: Vec<[u8; 4]> = palette
        .centroids
        .as_chunks::<3>()
        .0
        .iter()
        .map(|&rgb| opaque(rgb))
        .collect();
    rgba.resize(width * height, [0, 0, 0, 255]);
    Plane { width, height, rgba }
}

fn archive(meta: &str, images: &[Vec<u8>]) -> zip::result::ZipResult<Vec<u8>> {
    // A time of its own would make the bytes differ from run to run.
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default())
        .unix_permissions(0o644);
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let images = images.iter().map(Vec::as_slice);
    for (name, contents) in [META]
        .iter()
        .chain(&NAMES)
        .zip([meta.as_bytes()].into_iter().chain(images))
    {
        writer.start_file(*name, options)?;
        writer.write_all(contents)?;
    }
    Ok(writer.finish()?.into_inner())
}
