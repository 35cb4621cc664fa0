//! Photographs: decoding, masks, lenses, and reduction to the size of the view's camera.
//!
//! PNG, JPEG, WebP and TIFF are recognised by content, not by name. Grey, palette, 16-bit and CMYK images become 8-bit
//! RGB, rounded; alpha stays straight. Poses belong to the stored pixels, as COLMAP and nerfstudio calibrate them: an
//! orientation in EXIF data is applied only if the camera has the exchanged width and height.

mod cache;
mod header;
mod mask;
mod resample;
mod tags;

pub use resample::{half, reduce};

pub use cache::PhotoCache;
pub use header::dimensions;
pub use tags::{PhotoTags, tags};

pub(in crate::io) use mask::share_left_out;

use super::listing::SIDE_MAX;
use super::reader::Reader;
use super::source::Source;
use crate::error::{Error, Result};
use crate::scene::{Photo, PhotoSource, View};
use std::io::Cursor;
use std::path::Path;

/// Least width and height of a photograph: a single pixel has no detail to fit.
pub const SIDE_MIN: u32 = 2;

/// Decoder memory beside the pixels, in bytes.
const DECODER_BYTES: u64 = 1 << 19;

/// Loads a view's photograph at the size of the view's camera: decodes the file, removes the lens
/// distortion at full size, reduces by averaging over areas, weighted by alpha, and removes vignetting.
///
/// # Errors
/// The view has no photograph, or the file is missing, damaged, too large, or of another aspect ratio
/// than the camera. Each names the file.
pub fn load(view: &View) -> Result<Photo> {
    let (path, optics, orientation, mask, vignetting) = match &view.photo {
        PhotoSource::File {
            path,
            optics,
            orientation,
            mask,
            vignetting,
        } => (path, optics, *orientation, mask, vignetting),
        PhotoSource::Memory(photo) => {
            let camera = (view.camera.width, view.camera.height);
            assert_eq!((photo.width, photo.height), camera, "a photo in memory fits");
            return Ok(photo.clone());
        }
        PhotoSource::Absent => {
            let what = format!("the view {:?} has no photograph", view.name);
            return Err(Error::Config(what));
        }
    };
    let mut photo = decode(path)?;
    if let Some(mask) = mask {
        mask::apply(&mut photo, mask)?;
    }
    photo = tags::turned(photo, orientation);
    let (size, camera) = ((photo.width, photo.height), (view.camera.width, view.camera.height));
    let expected = optics
        .as_ref()
        .map_or(camera, |optics| (optics.size[0], optics.size[1]));
    if !same_aspect(size, expected) {
        return Err(wrong_aspect(path, size, expected));
    }
    if let Some(optics) = optics {
        let optics = match size == expected {
            true => **optics,
            false => optics.resized(size.0, size.1),
        };
        photo = resample::undistort(&photo, &optics);
    }
    let mut photo = resample::reduce(photo, camera.0, camera.1);
    if let Some(vignetting) = vignetting {
        vignetting.remove(&mut photo.rgba, &view.camera);
    }
    Ok(photo)
}

/// Decodes a file at its own size, as its pixels are stored.
pub fn decode<'a>(source: impl Into<Source<'a>>) -> Result<Photo> {
    let source = source.into();
    let path = source.name();
    // The header is checked against the limits before the decoder allocates anything.
    let (width, height) = dimensions(source)?;
    let bytes = Reader::all(source)?;
    header::check_complete(path, &bytes)?;
    let mut reader = image::ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(Error::io(path))?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(SIDE_MAX);
    limits.max_image_height = Some(SIDE_MAX);
    // 16-bit RGBA is eight bytes a pixel, twice for the rows or coefficients in progress; the extra chunks of a PNG
    // file must fit in as well.
    limits.max_alloc = Some(16 * u64::from(width) * u64::from(height) + DECODER_BYTES);
    reader.limits(limits);
    let image = reader
        .decode()
        .map_err(|e| Error::file(path, format!("cannot be decoded: {e}")))?
        .into_rgba8();
    if image.dimensions() != (width, height) {
        return Err(Error::file(path, "cannot be decoded: two sizes in one file"));
    }
    Ok(Photo {
        width,
        height,
        rgba: image.pixels().map(|pixel| pixel.0).collect(),
    })
}

/// True if one size is the other times a common factor, rounded up or down.
pub(super) fn same_aspect(a: (u32, u32), b: (u32, u32)) -> bool {
    let [aw, ah, bw, bh] = [a.0, a.1, b.0, b.1].map(f64::from);
    // Each side of the smaller size stands for an interval of factors from the larger.
    let factors = |large: f64, small: f64| (large / (small + 1.0), large / (small - 1.0).max(0.5));
    let (first, second) = if aw >= bw {
        (factors(aw, bw), factors(ah, bh))
    } else {
        (factors(bw, aw), factors(bh, ah))
    };
    first.0 <= second.1 && second.0 <= first.1
}

/// Error for a file with another aspect ratio than its camera.
pub(super) fn wrong_aspect(path: &Path, file: (u32, u32), camera: (u32, u32)) -> Error {
    let what = format!(
        "is {} x {} pixels, another aspect ratio than that of its camera, {} x {}",
        file.0, file.1, camera.0, camera.1
    );
    Error::file(path, what)
}
