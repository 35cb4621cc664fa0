//! Orientation and colour profile in a photograph's file.

use crate::error::{Error, Result};
use crate::scene::Photo;
use image::{ImageDecoder, ImageReader};
use std::path::Path;

/// Tags of a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoTags {
    /// Orientation in EXIF data, 1 to 8; 1 without.
    pub orientation: u8,
    /// Name of the colour profile, if it is another than sRGB.
    pub profile: Option<String>,
}

/// Reads the tags of a file; those of a file without any, or with damaged ones, are the usual ones.
///
/// # Errors
/// A file that cannot be opened, or is no image.
pub fn tags(path: &Path) -> Result<PhotoTags> {
    let reader = ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(Error::io(path))?;
    let mut decoder = reader
        .into_decoder()
        .map_err(|e| Error::file(path, format!("cannot be decoded: {e}")))?;
    let orientation = decoder.orientation().map_or(1, image::metadata::Orientation::to_exif);
    let profile = decoder.icc_profile().ok().flatten();
    Ok(PhotoTags {
        orientation,
        profile: profile.and_then(|bytes| profile_name(&bytes)),
    })
}

/// Names of profiles, as their descriptions hold them in ASCII or UTF-16, and the one that needs no word.
const PROFILES: [&str; 5] = ["Display P3", "Adobe RGB", "ProPhoto", "Rec. 2020", "Rec2020"];

/// Name of an ICC profile; `None` for sRGB.
fn profile_name(bytes: &[u8]) -> Option<String> {
    let has = |name: &str| {
        let wide: Vec<u8> = name.bytes().flat_map(|byte| [0, byte]).collect();
        let holds = |pattern: &[u8]| bytes.windows(pattern.len()).any(|window| window == pattern);
        holds(name.as_bytes()) || holds(&wide)
    };
    let known = PROFILES.into_iter().find(|name| has(name));
    match known {
        Some(name) => Some(name.to_owned()),
        None if has("sRGB") || has("GRAY") => None,
        None => Some("unknown".to_owned()),
    }
}

/// The photograph as its orientation asks for, of those that exchange width and height (5 to 8); others are left.
pub(super) fn turned(photo: Photo, orientation: u8) -> Photo {
    let (width, height) = (photo.width as usize, photo.height as usize);
    let source = |x: usize, y: usize| match orientation {
        5 => (y, x),
        6 => (y, height - 1 - x),
        7 => (width - 1 - y, height - 1 - x),
        _ => (width - 1 - y, x),
    };
    if !(5..=8).contains(&orientation) {
        return photo;
    }
    let rows = (0..width).flat_map(|y| (0..height).map(move |x| (x, y)));
    let pixel = |(x, y): (usize, usize)| {
        let (column, row) = source(x, y);
        photo.rgba[row * width + column]
    };
    Photo {
        width: photo.height,
        height: photo.width,
        rgba: rows.map(pixel).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orientations_turn_as_viewers_do() {
        let photo = Photo {
            width: 3,
            height: 2,
            rgba: (0..6).map(|i| [i; 4]).collect(),
        };
        for orientation in 1..=8 {
            let levels: Vec<u8> = photo.rgba.iter().flatten().copied().collect();
            let buffer = image::RgbaImage::from_raw(3, 2, levels).unwrap_or_default();
            let mut expected = image::DynamicImage::ImageRgba8(buffer);
            if let Some(tag) = image::metadata::Orientation::from_exif(orientation).filter(|_| orientation > 4) {
                expected.apply_orientation(tag);
            }
            let found = turned(photo.clone(), orientation);
            assert_eq!((found.width, found.height), (expected.width(), expected.height()));
            assert_eq!(found.rgba.as_flattened(), expected.as_bytes(), "{orientation}");
        }
    }

    #[test]
    fn profiles_are_known_by_name() {
        let wide = |name: &str| name.bytes().flat_map(|b| [0, b]).collect::<Vec<u8>>();
        assert_eq!(profile_name(&wide("Display P3")), Some("Display P3".into()));
        assert_eq!(profile_name(b"desc\0\0\0\0sRGB IEC61966-2.1"), None);
        assert_eq!(profile_name(b"some bytes"), Some("unknown".into()));
    }
}
