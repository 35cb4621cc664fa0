//! Orientation and colour profile in a photograph's file.

use crate::error::{Error, Result};
use crate::scene::Photo;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader, RgbaImage};
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
    let orientation = decoder.orientation().map_or(1, Orientation::to_exif);
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
    let exchanges = (5..=8).contains(&orientation);
    let Some(orientation) = Orientation::from_exif(orientation).filter(|_| exchanges) else {
        return photo;
    };
    let (width, height) = (photo.height, photo.width);
    let stored = RgbaImage::from_raw(photo.width, photo.height, photo.rgba.into_flattened());
    let mut image = DynamicImage::ImageRgba8(stored.unwrap_or_default());
    image.apply_orientation(orientation);
    Photo {
        width,
        height,
        rgba: image.into_rgba8().pixels().map(|pixel| pixel.0).collect(),
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
        let levels = |orientation: u8| -> (u32, Vec<u8>) {
            let found = turned(photo.clone(), orientation);
            assert_eq!(found.width * found.height, 6);
            (found.width, found.rgba.iter().map(|pixel| pixel[0]).collect())
        };
        for orientation in 0..=4 {
            assert_eq!(levels(orientation), (3, vec![0, 1, 2, 3, 4, 5]), "{orientation}");
        }
        assert_eq!(levels(5), (2, vec![0, 3, 1, 4, 2, 5]));
        assert_eq!(levels(6), (2, vec![3, 0, 4, 1, 5, 2]));
        assert_eq!(levels(7), (2, vec![5, 2, 4, 1, 3, 0]));
        assert_eq!(levels(8), (2, vec![2, 5, 1, 4, 0, 3]));
    }

    #[test]
    fn profiles_are_known_by_name() {
        let wide = |name: &str| name.bytes().flat_map(|b| [0, b]).collect::<Vec<u8>>();
        assert_eq!(profile_name(&wide("Display P3")), Some("Display P3".into()));
        assert_eq!(profile_name(b"desc\0\0\0\0sRGB IEC61966-2.1"), None);
        assert_eq!(profile_name(b"some bytes"), Some("unknown".into()));
    }
}
