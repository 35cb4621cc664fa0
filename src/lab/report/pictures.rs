//! Comparison pictures: photograph, rendering and their difference side by side.

use crate::Result;
use crate::io::png;
use std::path::Path;

/// Gain of the displayed difference: a deviation of 0.25 is full scale.
pub const DIFFERENCE_GAIN: f32 = 4.0;

/// Columns of grey between the pictures.
const GAP: usize = 4;

/// Writes photo | rendering | difference as one PNG. Both pictures are `[row][column]`, 0 to 1.
///
/// Panics if their sizes are not `width * height`.
pub fn comparison(path: &Path, [width, height]: [u32; 2], photo: &[[f32; 3]], rendering: &[[f32; 3]]) -> Result<()> {
    let pixels = width as usize * height as usize;
    assert_eq!([photo.len(), rendering.len()], [pixels; 2], "image sizes");
    let rows = photo.chunks(width as usize).zip(rendering.chunks(width as usize));
    let mut canvas = Vec::with_capacity(pixels * 3 + 2 * GAP * height as usize);
    for (photo, rendering) in rows {
        canvas.extend_from_slice(photo);
        canvas.extend([[0.5; 3]; GAP]);
        canvas.extend_from_slice(rendering);
        canvas.extend([[0.5; 3]; GAP]);
        canvas.extend(photo.iter().zip(rendering).map(difference));
    }
    png::write_rgb(path, 3 * width + 2 * GAP as u32, height, &canvas)
}

fn difference((a, b): (&[f32; 3], &[f32; 3])) -> [f32; 3] {
    [0, 1, 2].map(|channel| (a[channel] - b[channel]).abs() * DIFFERENCE_GAIN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_three_pictures_stand_side_by_side() -> std::result::Result<(), Box<dyn std::error::Error>> {
        let dir = tempfile::tempdir()?;
        let path = dir.path().join("a.png");
        let photo = [[0.0; 3], [1.0; 3], [0.2, 0.4, 0.6], [0.5; 3]];
        let rendering = [[0.0; 3], [0.8; 3], [0.2, 0.4, 0.6], [0.6, 0.5, 0.5]];
        comparison(&path, [2, 2], &photo, &rendering)?;
        let image = image::open(&path)?.to_rgb8();
        assert_eq!(image.dimensions(), (14, 2));
        assert_eq!(image.get_pixel(1, 0).0, [255; 3]);
        assert_eq!(image.get_pixel(7, 0).0, [204; 3]);
        assert_eq!(image.get_pixel(13, 0).0, [204; 3]);
        assert_eq!(image.get_pixel(12, 0).0, [0; 3]);
        assert_eq!(image.get_pixel(13, 1).0, [102, 0, 0]);
        Ok(())
    }
}
