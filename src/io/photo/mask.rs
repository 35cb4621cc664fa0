//! Masks by file: white keeps a pixel, black leaves it out.

use super::{decode, same_aspect};
use crate::error::{Error, Result};
use crate::scene::{MaskFile, Photo};

/// Level from which a mask keeps its pixel.
const KEPT_FROM: u8 = 128;

/// Makes the pixels that the mask leaves out transparent black. A mask of another size, in the same ratio, counts by
/// the nearest of its pixels.
///
/// # Errors
/// A file that cannot be read, or of another aspect ratio than the photograph.
pub(super) fn apply(photo: &mut Photo, mask: &MaskFile) -> Result<()> {
    let stored = decode(&mask.path)?;
    let size = (photo.width, photo.height);
    if !same_aspect((stored.width, stored.height), size) {
        let what = format!(
            "is a mask of {} x {} pixels, another aspect ratio than that of its photograph, {} x {}",
            stored.width, stored.height, size.0, size.1
        );
        return Err(Error::file(&mask.path, what));
    }
    let nearest = |at: u32, from: u32, to: u32| (u64::from(at) * u64::from(to) / u64::from(from)) as usize;
    let columns: Vec<usize> = (0..size.0).map(|x| nearest(x, size.0, stored.width)).collect();
    for (y, row) in (0..).zip(photo.rgba.chunks_exact_mut(size.0 as usize)) {
        let line = nearest(y, size.1, stored.height) * stored.width as usize;
        for (pixel, column) in row.iter_mut().zip(&columns) {
            if !keeps(stored.rgba[line + column], mask) {
                *pixel = [0; 4];
            }
        }
    }
    Ok(())
}

fn keeps([level, _, _, alpha]: [u8; 4], mask: &MaskFile) -> bool {
    (level >= KEPT_FROM && alpha >= KEPT_FROM) != mask.inverted
}

/// Share of the pixels that a mask leaves out.
///
/// # Errors
/// A file that cannot be read.
pub(in crate::io) fn share_left_out(mask: &MaskFile) -> Result<f64> {
    let stored = decode(&mask.path)?;
    let left_out = stored.rgba.iter().filter(|&&pixel| !keeps(pixel, mask)).count();
    Ok(left_out as f64 / stored.rgba.len().max(1) as f64)
}
