//! Reading scenes of either version.

use super::super::check::Check;
use super::super::loaded::{Collector, LoadedSplats, StoredAs};
use super::super::parallel::try_map;
use super::super::source::Source;
use super::archive::{META, META_BYTES_MAX, SogContainer};
use super::codes::{Decoder, Harmonics, SplatCodes, numbers_of};
use super::meta::{Meta, PaletteMeta};
use super::textures::{CodeImage, EncodedImage, SIDE_MAX};
use crate::error::{Error, Result};
use rayon::prelude::*;

/// Splats accepted in a file of any length.
const COUNT_FREE: u64 = 1 << 16;

/// Splats accepted for each byte of the file beyond [`COUNT_FREE`]. Images of one colour take a few bytes at any size,
/// so the size of a scene must be bounded by the length of its file; scenes of any content take at least three bytes a
/// splat, the low bytes of the mean. At degree 3 this is 1 KiB of memory for each byte of the file.
const COUNT_PER_BYTE: u64 = 4;

/// Most pixels of an image for `count` splats. Writers round the sides up to multiples of four.
fn pixels_max(count: u64) -> u64 {
    2 * count + (1 << 16)
}

/// Width of the image of the palette in entries.
const ENTRIES_WIDTH: usize = 64;

/// Most rows of entries, as labels have 16 bits.
const ENTRIES_HEIGHT_MAX: usize = 1024;

/// Reads a bundle, or the folder of a `meta.json`, of version 1 or 2. Splats whose means are too large for single
/// precision are dropped; rotations without the number of a component are read as none, labels beyond the palette as
/// zeros. Each is counted in a warning.
///
/// # Errors
/// Names the file, and the image in a bundle: no complete ZIP archive, entries of the same name or outside of the
/// archive, not JSON, another version, 2D Gaussians, streamed scenes (`lod-meta.json`), missing or damaged images,
/// images with losses, sizes that do not fit the number of splats, indices beyond a codebook, more splats than 65,536
/// and four for each byte of the file.
pub fn read<'a>(source: impl Into<Source<'a>>) -> Result<LoadedSplats> {
    let source = source.into();
    let (mut container, bytes) = SogContainer::open(source)?;
    let meta = Meta::parse(&bytes).map_err(|what| container.fault(META, what))?;
    let encoded = open_images(&mut container, &meta)?;
    let images = try_map(encoded.into_par_iter().zip(&meta.names), |(encoded, name)| {
        let image = encoded.decode();
        image.map_err(|what| container.fault(name, what))
    })?;
    let count = meta.count as usize;
    check_indices(&container, &meta, &images, count)?;
    let harmonics = meta.palette.as_ref().zip(images.get(5));
    let harmonics = harmonics.map(|(palette, image)| decode_palette(palette, image));
    let harmonics = harmonics
        .transpose()
        .map_err(|what| container.fault(&meta.names[5], what))?;
    let degree = harmonics.as_ref().map_or(0, |harmonics| harmonics.sh_degree);
    let mut collector = Collector::new(count, degree, meta.filter);
    let mut decoder = Decoder::new(&meta.tables, harmonics.as_ref());
    for i in 0..count {
        decoder.push(&row(&images, i), &mut collector);
    }
    let path = source.name().display();
    let mut warnings: Vec<String> = meta.warnings.iter().map(|what| format!("{path}: {what}")).collect();
    if decoder.unrotated > 0 {
        let (n, name) = (decoder.unrotated, super::super::reader::excerpt(&meta.names[2]));
        warnings.push(format!(
            "{path}: {name}: {n} of {count} splats have no number of a largest component, read as no rotation"
        ));
    }
    if let (Some(harmonics), 1..) = (&harmonics, decoder.unlabelled) {
        let entries = harmonics.entries.len() / numbers_of(degree);
        warnings.push(format!(
            "{path}: {} of {count} splats have labels beyond the {entries} entries of the palette, read without \
             harmonics",
            decoder.unlabelled
        ));
    }
    Ok(collector.finish(source.name(), StoredAs::ply(meta.format), warnings))
}

/// Reads the images and compares their sizes with the number of splats.
fn open_images(container: &mut SogContainer, meta: &Meta) -> Result<Vec<EncodedImage>> {
    let count = meta.count;
    for name in &meta.names {
        container.check_name(name)?;
    }
    let names: Vec<&str> = meta.names.iter().map(String::as_str).collect();
    let bytes = container.bytes(&names)?;
    let most = COUNT_FREE + COUNT_PER_BYTE.saturating_mul(bytes);
    if count > most {
        let what = format!("{count} splats are announced; {bytes} bytes can hold {most} at most");
        return Err(container.fault(META, what));
    }
    let palette_pixels = (ENTRIES_WIDTH * 15 * ENTRIES_HEIGHT_MAX) as u64;
    let mut images: Vec<EncodedImage> = Vec::with_capacity(names.len());
    for (i, name) in names.iter().enumerate() {
        let is_palette = i == 5;
        let pixels = if is_palette { palette_pixels } else { pixels_max(count) };
        // Incompressible pixels take little more than four bytes.
        let file = container.read(name, 5 * pixels + META_BYTES_MAX)?;
        let image = EncodedImage::parse(file).map_err(|what| container.fault(name, what))?;
        let fault = if is_palette {
            check_palette_size(&image)
        } else {
            check_size(&image, count, images.first())
        };
        fault.map_err(|what| container.fault(name, what))?;
        images.push(image);
    }
    Ok(images)
}

fn check_size(image: &EncodedImage, count: u64, first: Option<&EncodedImage>) -> Check<()> {
    let EncodedImage { width, height, .. } = *image;
    let pixels = width as u64 * height as u64;
    let size = format!("is {width} x {height} pixels");
    if let Some(first) = first.filter(|first| (first.width, first.height) != (width, height)) {
        return Err(format!(
            "{size}, but the first image {} x {}",
            first.width, first.height
        ));
    }
    if pixels < count {
        return Err(format!("{size}, too few for the {count} splats announced"));
    }
    if width.max(height) > SIDE_MAX || pixels > pixels_max(count) {
        let most = pixels_max(count);
        return Err(format!("{size}; {count} splats need {most} pixels at most"));
    }
    Ok(())
}

fn check_palette_size(image: &EncodedImage) -> Check<()> {
    let EncodedImage { width, height, .. } = *image;
    if sh_degree_of(width).is_some() && height <= ENTRIES_HEIGHT_MAX {
        return Ok(());
    }
    Err(format!(
        "is {width} x {height} pixels; widths of 192, 512 and 960 and heights to {ENTRIES_HEIGHT_MAX} are possible"
    ))
}

/// SH degree by the width of the palette's image.
fn sh_degree_of(width: usize) -> Option<u32> {
    (1..=3).find(|&degree| width == ENTRIES_WIDTH * numbers_of(degree) / 3)
}

/// Refuses indices beyond a codebook.
fn check_indices(container: &SogContainer, meta: &Meta, images: &[CodeImage], count: usize) -> Result<()> {
    let tables = [(3, &meta.tables.scale), (4, &meta.tables.color)];
    for (image, tables) in tables {
        let rgba = images[image].rgba.iter().take(count);
        let most = rgba.fold([0; 3], |most, rgba| [0, 1, 2].map(|c| rgba[c].max(most[c])));
        for (most, table) in most.into_iter().zip(tables) {
            check_index(container, &meta.names[image], most, table, count)?;
        }
    }
    if let (Some(palette), Some(image)) = (&meta.palette, images.get(5)) {
        let most = image
            .rgba
            .iter()
            .flat_map(|rgba| &rgba[..3])
            .fold(0, |most, v| most.max(*v));
        check_index(container, &meta.names[5], most, &palette.table, count)?;
    }
    Ok(())
}

fn check_index(container: &SogContainer, name: &str, most: u8, table: &[f32], count: usize) -> Result<()> {
    let length = table.len();
    if count == 0 || usize::from(most) < length {
        return Ok(());
    }
    let what = format!("refers to value {most} of a codebook of {length} values");
    Err::<(), Error>(container.fault(name, what))
}

fn decode_palette(palette: &PaletteMeta, image: &CodeImage) -> Check<Harmonics> {
    let Some(sh_degree) = sh_degree_of(image.width) else {
        return Err(format!("is {} pixels wide", image.width));
    };
    if palette.sh_degree.is_some_and(|stated| stated != sh_degree) {
        let stated = palette.sh_degree.unwrap_or_default();
        return Err(format!(
            "is {} pixels wide, which is degree {sh_degree}, but shN has {stated} bands",
            image.width
        ));
    }
    // Entries follow each other in the rows, as their texels do: the image is the list.
    let value = |code: &u8| palette.table.get(usize::from(*code)).copied().unwrap_or_default();
    let codes = image.rgba.iter().flat_map(|rgba| &rgba[..3]);
    Ok(Harmonics {
        sh_degree,
        entries: codes.map(value).collect(),
    })
}

fn row(images: &[CodeImage], i: usize) -> SplatCodes {
    let at = |image: usize| images[image].rgba[i];
    let [low, high, quaternion, scale, color] = [at(0), at(1), at(2), at(3), at(4)];
    let mean = |axis: usize| u16::from_le_bytes([low[axis], high[axis]]);
    let label = images.get(6).map_or([0; 4], |labels| labels.rgba[i]);
    SplatCodes {
        mean: [mean(0), mean(1), mean(2)],
        quaternion,
        scale: [scale[0], scale[1], scale[2]],
        color,
        label: u16::from_le_bytes([label[0], label[1]]),
    }
}
