//! Images read back from the device.

use super::surface::Surface;
use crate::scene::Camera;
use rayon::prelude::*;

/// An image read back from the device.
#[derive(Clone, Debug)]
pub struct RenderedImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// RGB of each pixel, row by row from the top; display-referred, background blended in, not clamped at 1.
    pub rgb: Vec<[f32; 3]>,
    /// Transmittance of all splats in each pixel, 0 to 1.
    pub transmittance: Vec<f32>,
    /// Σ weight · z of each pixel in world units, z of the splats' means; divide by 1 − transmittance for the mean.
    /// Empty unless requested ([`RenderOptions::with_depth`]).
    pub depth: Vec<f32>,
    /// Index of the splat at which the coverage of each pixel reaches 1/2, or [`NO_SPLAT`](crate::layout::NO_SPLAT)
    /// where it does not; of instances by [`locate`](super::locate). Empty unless requested
    /// ([`RenderOptions::with_ids`](super::RenderOptions::with_ids)).
    pub ids: Vec<u32>,
    /// Depth of that splat's mean along the view's z axis in world units; infinite without one. Empty as `ids`.
    pub id_depth: Vec<f32>,
    /// Depths and normals, if requested ([`RenderOptions::with_surface`]).
    pub surface: Option<Surface>,
}

/// Coverage below which a pixel has no depth: one 8-bit level.
const COVERAGE_MIN: f32 = 1.0 / 255.0;

impl RenderedImage {
    /// Appends the rows below.
    pub(super) fn append(&mut self, below: RenderedImage) {
        self.height += below.height;
        self.rgb.extend(below.rgb);
        self.transmittance.extend(below.transmittance);
        self.depth.extend(below.depth);
        self.ids.extend(below.ids);
        self.id_depth.extend(below.id_depth);
        if let (Some(surface), Some(below)) = (&mut self.surface, below.surface) {
            surface.append(below);
        }
    }

    /// Coverage of each pixel, 0 to 1.
    pub fn alpha(&self) -> Vec<f32> {
        self.transmittance.iter().map(|t| 1.0 - t).collect()
    }

    /// Mean depth of each pixel along the view's z axis in world units; infinite where coverage is below 1/255. Empty
    /// unless depth was requested.
    pub fn mean_depth(&self) -> Vec<f32> {
        let mean = |(sum, transmittance): (&f32, &f32)| match 1.0 - transmittance {
            alpha if alpha >= COVERAGE_MIN => sum / alpha,
            _ => f32::INFINITY,
        };
        self.depth.iter().zip(&self.transmittance).map(mean).collect()
    }
}

/// Decodes the planes of a device's frame.
pub(super) fn unpack(camera: &Camera, image: &[f32], depth: Vec<f32>, surface: Option<&[f32]>) -> RenderedImage {
    let pixels = camera.width as usize * camera.height as usize;
    let rgb = (0..pixels)
        .into_par_iter()
        .map(|i| [image[i], image[pixels + i], image[2 * pixels + i]])
        .collect();
    let transmittance = image[3 * pixels..].to_vec();
    let surface = surface.map(|planes| Surface::unpack(camera, planes, &transmittance));
    RenderedImage {
        width: camera.width,
        height: camera.height,
        rgb,
        transmittance,
        depth,
        ids: Vec::new(),
        id_depth: Vec::new(),
        surface,
    }
}
