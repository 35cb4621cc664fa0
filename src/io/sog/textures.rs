//! Images that hold codes: checked sizes, decoding and encoding.

use super::super::check::Check;
use super::super::photo;
use super::super::source::Source;
use crate::error::Error;
use image::ImageDecoder;
use image::codecs::webp::WebPDecoder;
use std::io::Cursor;
use std::path::Path;

/// Largest side in pixels of a lossless WebP image.
pub(super) const SIDE_MAX: usize = 1 << 14;

/// Decoded image, row by row from the top.
pub(super) struct CodeImage {
    pub(super) width: usize,
    pub(super) rgba: Vec<[u8; 4]>,
}

/// Compressed image with the size that its header states.
pub(super) struct EncodedImage {
    pub(super) width: usize,
    pub(super) height: usize,
    /// File of the image data alone, without animation, profiles and other chunks.
    file: Vec<u8>,
}

impl EncodedImage {
    /// Reads the header of a lossless WebP or PNG image; an error says what is wrong with it.
    pub(super) fn parse(bytes: Vec<u8>) -> Check<EncodedImage> {
        if bytes.starts_with(b"\x89P") {
            let size = photo::dimensions(Source::bytes(Path::new(""), &bytes)).map_err(fault_of)?;
            return Ok(EncodedImage {
                width: size.0 as usize,
                height: size.1 as usize,
                file: bytes,
            });
        }
        let data = lossless_data(&bytes)?;
        let &[0x2f, a, b, c, d, ..] = data else {
            return Err("the WebP image has no lossless header".into());
        };
        let sizes = u32::from_le_bytes([a, b, c, d]);
        let (width, height) = (sizes & 0x3fff, sizes >> 14 & 0x3fff);
        let padded = data.len() + data.len() % 2;
        let mut file = Vec::with_capacity(padded + 20);
        file.extend(b"RIFF");
        file.extend((padded as u32 + 12).to_le_bytes());
        file.extend(b"WEBPVP8L");
        file.extend((data.len() as u32).to_le_bytes());
        file.extend(data);
        file.resize(padded + 20, 0);
        Ok(EncodedImage {
            width: width as usize + 1,
            height: height as usize + 1,
            file,
        })
    }

    /// Decodes the image; the caller has compared its size with the number of splats.
    pub(super) fn decode(self) -> Check<CodeImage> {
        let EncodedImage { width, height, file } = self;
        let texture = |rgba| CodeImage { width, rgba };
        if file.starts_with(b"\x89P") {
            let photo = photo::decode(Source::bytes(Path::new(""), &file)).map_err(fault_of)?;
            return Ok(texture(photo.rgba));
        }
        let said = |e: image::ImageError| format!("cannot be decoded: {e}");
        let decoder = WebPDecoder::new(Cursor::new(&file)).map_err(said)?;
        if decoder.dimensions() != (width as u32, height as u32) {
            return Err("cannot be decoded: two sizes in one file".into());
        }
        let has_alpha = decoder.color_type().has_alpha();
        let mut bytes = vec![0; width * height * if has_alpha { 4 } else { 3 }];
        if decoder.total_bytes() != bytes.len() as u64 {
            return Err("cannot be decoded: not 8 bits a channel".into());
        }
        decoder.read_image(&mut bytes).map_err(said)?;
        let rgba = match has_alpha {
            true => bytes.as_chunks::<4>().0.to_vec(),
            false => bytes
                .as_chunks::<3>()
                .0
                .iter()
                .map(|&[r, g, b]| [r, g, b, 255])
                .collect(),
        };
        Ok(texture(rgba))
    }
}

/// A message without the file's name, which the caller adds.
fn fault_of(error: Error) -> String {
    match error {
        Error::File { what, .. } => what,
        other => other.to_string(),
    }
}

/// Contents of the chunk `VP8L` of a WebP file.
fn lossless_data(bytes: &[u8]) -> Check<&[u8]> {
    if bytes.is_empty() {
        return Err("is empty".into());
    }
    let Some((b"RIFF", rest)) = bytes.split_first_chunk::<4>() else {
        return Err("is neither a WebP nor a PNG image".into());
    };
    let Some(mut rest) = rest.get(4..).and_then(|rest| rest.strip_prefix(b"WEBP")) else {
        return Err("is neither a WebP nor a PNG image".into());
    };
    while let Some((&[k0, k1, k2, k3, l0, l1, l2, l3], chunk)) = rest.split_first_chunk::<8>() {
        let length = u32::from_le_bytes([l0, l1, l2, l3]) as usize;
        match &[k0, k1, k2, k3] {
            b"VP8L" => {
                let data = chunk.get(..length);
                return data.ok_or_else(|| "the WebP image is cut short".into());
            }
            b"VP8 " => return Err("is a WebP image with losses, which change codes".into()),
            b"ANIM" | b"ANMF" => return Err("is an animated WebP image".into()),
            _ => rest = chunk.get(length + length % 2..).unwrap_or_default(),
        }
    }
    Err("the WebP file holds no image".into())
}

/// Encodes an image without losses, and colours where alpha is 0 as well, because alpha holds codes.
pub(super) fn encode(rgba: &[[u8; 4]], width: usize, height: usize) -> Check<Vec<u8>> {
    let mut config = webp::WebPConfig::new().map_err(|()| "the WebP encoder is of another version")?;
    config.lossless = 1;
    config.exact = 1;
    // More effort takes many times as long and hardly shortens images of codes.
    (config.method, config.quality) = (4, 75.0);
    let encoder = webp::Encoder::from_rgba(rgba.as_flattened(), width as u32, height as u32);
    let encoded = encoder.encode_advanced(&config);
    let encoded = encoded.map_err(|e| format!("an image of {width} x {height} pixels cannot be encoded: {e:?}"))?;
    Ok(encoded.to_vec())
}
