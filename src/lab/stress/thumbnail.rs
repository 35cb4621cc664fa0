//! Thumbnails: small pictures embedded in the page.

use crate::Result;
use crate::io::png;

/// A picture of the page.
#[derive(Clone, Debug, PartialEq)]
pub struct Thumbnail {
    /// Caption.
    pub label: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Three bytes a pixel, row by row.
    rgb: Vec<u8>,
}

/// Longest side in pixels; larger pictures are subsampled.
const SIDE_MAX: u32 = 400;

impl Thumbnail {
    /// Thumbnail of display-referred colours `[row][column]`, 0 to 1; large pictures are subsampled.
    ///
    /// Panics if there are not as many colours as pixels.
    pub fn new(label: impl Into<String>, [width, height]: [u32; 2], colors: &[[f32; 3]]) -> Thumbnail {
        let pixels = width as usize * height as usize;
        assert_eq!(colors.len(), pixels, "as many colours as pixels");
        let step = width.max(height).div_ceil(SIDE_MAX) as usize;
        let rows = colors.chunks(width as usize).step_by(step);
        let kept = rows.flat_map(|row| row.iter().step_by(step));
        Thumbnail {
            label: label.into(),
            size: [width, height].map(|side| side.div_ceil(step as u32)),
            rgb: kept.flatten().map(|&value| png::to_byte(value)).collect(),
        }
    }

    /// The picture as a data URL.
    pub(super) fn address(&self) -> Result<String> {
        let file = png::encode_rgb(self.size[0], self.size[1], &self.rgb)?;
        Ok(format!("data:image/png;base64,{}", base64(&file)))
    }
}

/// Base 64 of RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let bits = (0..3).fold(0, |bits, i| bits << 8 | u32::from(three.get(i).copied().unwrap_or(0)));
        for i in 0..4 {
            match i <= three.len() {
                true => text.push(char::from(DIGITS[(bits >> (18 - 6 * i) & 63) as usize])),
                false => text.push('='),
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        let cases = [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
        ];
        for (bytes, text) in cases {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn large_pictures_are_thinned() {
        let colors = vec![[0.5; 3]; 1000];
        let thumbnail = Thumbnail::new("wide", [1000, 1], &colors);
        assert_eq!(thumbnail.size, [334, 1]);
        assert_eq!(thumbnail.rgb.len(), 334 * 3);
        let address = thumbnail.address();
        assert!(address.is_ok_and(|a| a.starts_with("data:image/png;base64,iVBOR")));
    }
}
