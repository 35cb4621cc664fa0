//! Files of a rendered picture.

use super::{BitDepth, Format, Show};
use crate::io::png::{write_rgb, write_rgb16, write_rgba, write_rgba16};
use crate::render::{RenderedImage, Surface};
use crate::scene::{Camera, srgb_to_linear};
use crate::{Result, io};
use glam::Vec3;
use std::path::Path;

/// Form of the pictures.
#[derive(Clone, Copy, Debug)]
pub(super) struct PictureForm {
    pub(super) format: Format,
    pub(super) show: Show,
    pub(super) bits: BitDepth,
}

impl PictureForm {
    /// Name of the file of a picture.
    pub(super) fn file_name(self, stem: &str) -> String {
        match (self.format, self.show) {
            (Format::Exr, _) => format!("{stem}.exr"),
            (_, Show::Color) => format!("{stem}.png"),
            (_, Show::Alpha) => format!("{stem}_alpha.png"),
            (_, Show::Depth) => format!("{stem}_depth.png"),
            (_, Show::Normal) => format!("{stem}_normal.png"),
        }
    }

    /// Writes a picture.
    pub(super) fn write(self, path: &Path, camera: &Camera, picture: &RenderedImage) -> Result<()> {
        let (width, height) = (picture.width, picture.height);
        if self.format == Format::Exr {
            return write_exr(path, picture);
        }
        match (self.bits, PixelColors::of(self.show, camera, picture)) {
            (BitDepth::Eight, PixelColors::Opaque(rgb)) => write_rgb(path, width, height, &rgb),
            (BitDepth::Eight, PixelColors::Transparent(rgba)) => write_rgba(path, width, height, &rgba),
            (BitDepth::Sixteen, PixelColors::Opaque(rgb)) => write_rgb16(path, width, height, &rgb),
            (BitDepth::Sixteen, PixelColors::Transparent(rgba)) => write_rgba16(path, width, height, &rgba),
        }
    }

    /// Colours of a frame of video.
    pub(super) fn frame(self, camera: &Camera, picture: &RenderedImage, background: [f32; 3]) -> Vec<[f32; 3]> {
        match PixelColors::of(self.show, camera, picture) {
            PixelColors::Opaque(rgb) => rgb,
            PixelColors::Transparent(rgba) => {
                let over = |&[r, g, b, alpha]: &[f32; 4]| {
                    let [x, y, z] = background.map(|v| v * (1.0 - alpha));
                    [r * alpha + x, g * alpha + y, b * alpha + z]
                };
                rgba.iter().map(over).collect()
            }
        }
    }
}

/// Colours for people, 0 to 1, with straight alpha.
enum PixelColors {
    Opaque(Vec<[f32; 3]>),
    Transparent(Vec<[f32; 4]>),
}

impl PixelColors {
    fn of(show: Show, camera: &Camera, picture: &RenderedImage) -> PixelColors {
        match (show, &picture.surface) {
            (Show::Depth, Some(surface)) => PixelColors::Transparent(depth_picture(&surface.median_depth)),
            (Show::Normal, Some(surface)) => PixelColors::Transparent(normal_picture(camera, &surface.normal)),
            (Show::Alpha, _) => PixelColors::Opaque(picture.alpha().into_iter().map(|alpha| [alpha; 3]).collect()),
            _ => PixelColors::Opaque(picture.rgb.clone()),
        }
    }
}

/// All layers. Depth is that of the means, and there are no normals, by the rules of the 3DGS code.
fn write_exr(path: &Path, picture: &RenderedImage) -> Result<()> {
    let pixels = picture.rgb.iter().zip(picture.alpha());
    let rgba: Vec<[f32; 4]> = pixels.map(|(rgb, alpha)| linear(*rgb, alpha)).collect();
    let (width, height) = (picture.width, picture.height);
    if let Some(surface) = &picture.surface {
        return io::exr::write(path, width, height, &rgba, &surface.median_depth, Some(&surface.normal));
    }
    let at = |(depth, transmittance): (f32, &f32)| match Surface::is_at(*transmittance) {
        true => depth,
        false => f32::NAN,
    };
    let depth: Vec<f32> = picture
        .mean_depth()
        .into_iter()
        .zip(&picture.transmittance)
        .map(at)
        .collect();
    io::exr::write(path, width, height, &rgba, &depth, None)
}

/// Shares of a picture's depths outside of its range of greys, at either end.
const CLIPPED: f64 = 0.01;

/// Depths in grey, even in 1 / z, near white; without a surface transparent.
fn depth_picture(depth: &[f32]) -> Vec<[f32; 4]> {
    let mut inverse: Vec<f32> = depth.iter().filter(|z| !z.is_nan()).map(|z| 1.0 / z).collect();
    inverse.sort_by(f32::total_cmp);
    let last = inverse.len().saturating_sub(1) as f64;
    let place = |share: f64| inverse.get((last * share).round() as usize).copied().unwrap_or(0.0);
    let (far, near) = (place(CLIPPED), place(1.0 - CLIPPED));
    // A level surface is white.
    let range = if near > far { near - far } else { f32::MIN_POSITIVE };
    // A tenth of the greys sets what is farthest apart from black, the colour of nothing.
    let grey = |z: f32| 0.1 + 0.9 * ((1.0 / z - far) / range).clamp(0.0, 1.0);
    let pixel = |&z: &f32| match z.is_nan() {
        true => [0.0; 4],
        false => [grey(z), grey(z), grey(z), 1.0],
    };
    depth.iter().map(pixel).collect()
}

/// Normals as colours, (n + 1) / 2 along x right, y up and z toward the camera; without a surface transparent.
pub(in crate::cli) fn normal_picture(camera: &Camera, normal: &[[f32; 3]]) -> Vec<[f32; 4]> {
    let view_from_world = camera.rotation.as_mat3();
    let pixel = |&normal: &[f32; 3]| {
        let Vec3 { x, y, z } = view_from_world * Vec3::from(normal);
        match x.is_nan() {
            true => [0.0; 4],
            false => [0.5 + 0.5 * x, 0.5 - 0.5 * y, 0.5 - 0.5 * z, 1.0],
        }
    };
    normal.iter().map(pixel).collect()
}

/// Converts display-referred colour over black to linear light, premultiplied. The curve applies to the colour without
/// coverage.
fn linear(rgb: [f32; 3], alpha: f32) -> [f32; 4] {
    let channel = |value: f32| {
        if alpha <= 0.0 {
            return 0.0;
        }
        alpha * srgb_to_linear((value / alpha).into()) as f32
    };
    let [r, g, b] = rgb.map(channel);
    [r, g, b, alpha]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2, DVec3};

    #[test]
    fn exr_colours_are_linear_and_premultiplied() {
        assert_eq!(linear([1.0, 0.0, 1.0], 1.0), [1.0, 0.0, 1.0, 1.0]);
        let [half, ..] = linear([0.5, 0.0, 0.0], 0.5);
        assert_eq!(half, 0.5);
        let [grey, ..] = linear([0.5; 3], 1.0);
        assert!((grey - 0.214_041).abs() < 1e-5);
        assert_eq!(linear([0.0; 3], 0.0), [0.0; 4]);
    }

    #[test]
    fn depths_are_grey_and_near_is_bright() {
        let picture = depth_picture(&[2.0, 4.0, f32::NAN, 8.0]);
        assert_eq!(picture[0], [1.0; 4]);
        assert!((picture[1][0] - 0.4).abs() < 1e-6 && picture[1][3] == 1.0);
        assert_eq!(picture[2], [0.0; 4]);
        assert!((picture[3][0] - 0.1).abs() < 1e-6);
        assert_eq!(depth_picture(&[f32::NAN; 2]), [[0.0; 4]; 2]);
        assert!(depth_picture(&[3.0; 2]).as_flattened().iter().all(|x| x.is_finite()));
    }

    #[test]
    fn normals_are_coloured_in_the_camera_axes() {
        let camera = Camera {
            // Looks along x of the world; y of the world is down.
            rotation: DMat3::from_cols(DVec3::Z, DVec3::Y, -DVec3::X),
            position: DVec3::ZERO,
            focal: DVec2::ONE,
            center: DVec2::ZERO,
            width: 1,
            height: 1,
        };
        // Toward the camera; up; nothing.
        let picture = normal_picture(&camera, &[[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [f32::NAN; 3]]);
        assert_eq!(picture, [[0.5, 0.5, 1.0, 1.0], [0.5, 1.0, 0.5, 1.0], [0.0; 4]]);
    }
}
