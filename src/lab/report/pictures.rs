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
pub fn comparison(path: &Path, size: [u32; 2], photo: &[[f32; 3]], rendering: &[[f32; 3]]) -> Result<()> {
    let differences: Vec<[f32; 3]> = photo.iter().zip(rendering).map(difference).collect();
    side_by_side(path, size, &[photo, rendering, &differences])
}

/// Writes pictures as one PNG, from left to right. Each is `[row][column]`, 0 to 1.
///
/// Panics if their sizes are not `width * height`.
pub fn side_by_side(path: &Path, [width, height]: [u32; 2], pictures: &[&[[f32; 3]]]) -> Result<()> {
    let pixels = width as usize * height as usize;
    assert!(pictures.iter().all(|picture| picture.len() == pixels), "image sizes");
    let gaps = pictures.len().saturating_sub(1);
    let mut canvas = Vec::with_capacity(pixels * pictures.len() + gaps * GAP * height as usize);
    for row in 0..height as usize {
        for (at, picture) in pictures.iter().enumerate() {
            if at > 0 {
                canvas.extend([[0.5; 3]; GAP]);
            }
            canvas.extend_from_slice(&picture[row * width as usize..][..width as usize]);
        }
    }
    let all = pictures.len() as u32 * width + (gaps * GAP) as u32;
    png::write_rgb(path, all, height, &canvas)
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
