//! Images as PNG files of 8 or 16 bits.

use super::atomic::write_atomically;
use crate::error::{Error, Result};
use crate::scene::Photo;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::path::Path;

/// A channel as a byte: clamped to 0 to 1 and rounded to the nearest 255th; NaN is 0.
pub fn to_byte(value: f32) -> u8 {
    // The cast saturates and sends NaN to 0.
    (value * 255.0).round() as u8
}

/// Writes display-referred colours `[row][column]`, 0 to 1.
pub fn write_rgb(path: &Path, width: u32, height: u32, pixels: &[[f32; 3]]) -> Result<()> {
    let bytes: Vec<u8> = pixels.iter().flatten().map(|v| to_byte(*v)).collect();
    write_bytes(path, width, height, &bytes, ExtendedColorType::Rgb8)
}

/// A file of red, green and blue bytes, row by row.
///
/// # Errors
/// Wrong number of bytes for the size.
pub fn encode_rgb(width: u32, height: u32, bytes: &[u8]) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    PngEncoder::new(&mut file)
        .write_image(bytes, width, height, ExtendedColorType::Rgb8)
        .map_err(|error| Error::Config(format!("a picture cannot be encoded: {error}")))?;
    Ok(file)
}

/// Writes display-referred colours with straight alpha `[row][column]`, 0 to 1.
pub fn write_rgba(path: &Path, width: u32, height: u32, pixels: &[[f32; 4]]) -> Result<()> {
    let bytes: Vec<u8> = pixels.iter().flatten().map(|v| to_byte(*v)).collect();
    write_bytes(path, width, height, &bytes, ExtendedColorType::Rgba8)
}

/// As [`write_rgb`], with 16 bits a channel: values are rounded to the nearest 65,535th.
pub fn write_rgb16(path: &Path, width: u32, height: u32, pixels: &[[f32; 3]]) -> Result<()> {
    write_bytes(
        path,
        width,
        height,
        &to_words(pixels.as_flattened()),
        ExtendedColorType::Rgb16,
    )
}

/// As [`write_rgba`], with 16 bits a channel.
pub fn write_rgba16(path: &Path, width: u32, height: u32, pixels: &[[f32; 4]]) -> Result<()> {
    write_bytes(
        path,
        width,
        height,
        &to_words(pixels.as_flattened()),
        ExtendedColorType::Rgba16,
    )
}

/// Channels as 16-bit words of the machine's byte order, as the encoder takes them; NaN is 0.
fn to_words(channels: &[f32]) -> Vec<u8> {
    let word = |value: &f32| ((f64::from(*value) * 65_535.0).round() as u16).to_ne_bytes();
    channels.iter().flat_map(word).collect()
}

/// Writes a photograph unchanged.
pub fn write_photo(path: &Path, photo: &Photo) -> Result<()> {
    let bytes = photo.rgba.as_flattened();
    write_bytes(path, photo.width, photo.height, bytes, ExtendedColorType::Rgba8)
}

fn write_bytes(path: &Path, width: u32, height: u32, bytes: &[u8], color: ExtendedColorType) -> Result<()> {
    let bytes_each = usize::from(color.bits_per_pixel() / 8);
    assert_eq!(
        bytes.len(),
        width as usize * height as usize * bytes_each,
        "as many pixels as the image has"
    );
    write_atomically(path, |file| {
        PngEncoder::new(file)
            .write_image(bytes, width, height, color)
            .map_err(std::io::Error::other)
    })
}
