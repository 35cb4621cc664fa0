//! Depth of a surface through one camera, as fusion reads it.

use crate::scene::Camera;
use glam::{DVec2, DVec3, Vec3};

/// A camera's depths, slopes and colours, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    /// The camera.
    pub camera: Camera,
    /// Depth along the view's z axis, world units; NaN without a surface.
    pub depth: Vec<f32>,
    /// |n · r| with the unit normal n and the ray r of length 1 along z: distance from the surface per depth.
    pub slope: Vec<f32>,
    /// Display-referred red, green, blue, not multiplied by coverage, and coverage.
    pub color: Vec<[u8; 4]>,
}

/// Depths farther than this many medians of all depths are left out: their pixels are as much larger than a voxel.
const FAR: f32 = 4.0;

/// Least cosine between ray and normal: the depths of surfaces seen at a lower angle are uncertain. cos 80°.
const COSINE_MIN: f32 = 0.173_648;

impl DepthMap {
    /// Map of a frame's surface: `depth` in world units along z and `normal` in the world, both NaN without a surface;
    /// `rgb` over black, `alpha` the coverage.
    pub fn new(camera: &Camera, depth: &[f32], normal: &[[f32; 3]], rgb: &[[f32; 3]], alpha: &[f32]) -> DepthMap {
        let pixels = camera.width as usize * camera.height as usize;
        assert!(
            [depth.len(), normal.len(), rgb.len(), alpha.len()] == [pixels; 4],
            "one of each per pixel"
        );
        let slope = |i: usize| {
            let x = (i % camera.width as usize) as f64 + 0.5;
            let y = (i / camera.width as usize) as f64 + 0.5;
            let normal = DVec3::from(normal[i].map(f64::from));
            normal.dot(camera.ray_from_pixel(DVec2::new(x, y))).abs() as f32
        };
        let level = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        let color = |i: usize| {
            let [r, g, b] = rgb[i].map(|c| level(c / alpha[i].max(1e-6)));
            [r, g, b, level(alpha[i])]
        };
        DepthMap {
            camera: *camera,
            depth: depth.to_vec(),
            slope: (0..pixels).map(slope).collect(),
            color: (0..pixels).map(color).collect(),
        }
    }

    /// Display-referred colour of a pixel.
    pub(super) fn rgb(&self, pixel: usize) -> Vec3 {
        let [red, green, blue, _] = self.color[pixel].map(|c| f32::from(c) / 255.0);
        Vec3::new(red, green, blue)
    }

    /// Bytes of a map of so many pixels.
    pub fn bytes(pixels: usize) -> u64 {
        12 * pixels as u64
    }

    /// The map at a whole fraction of its size that takes at most so many bytes, with mean colours and the depths in
    /// the middle; `None` if the map itself does.
    pub(super) fn reduced_to(&self, bytes: u64) -> Option<DepthMap> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let excess = DepthMap::bytes(width * height) as f64 / bytes as f64;
        if excess <= 1.0 {
            return None;
        }
        let by = (excess.sqrt().ceil() as usize).min(width).min(height);
        let (columns, rows) = (width / by, height / by);
        let first = |pixel: usize| (pixel / columns * by) * width + pixel % columns * by;
        let middle = |pixel: usize| first(pixel) + by / 2 * (width + 1);
        let mean = |pixel: usize| {
            let block = (0..by * by).map(|i| self.color[first(pixel) + i / by * width + i % by]);
            let sums = block.fold([0; 4], |sum: [u32; 4], color| {
                [0, 1, 2, 3].map(|i| sum[i] + u32::from(color[i]))
            });
            sums.map(|sum| (sum as f32 / (by * by) as f32).round() as u8)
        };
        let of = |values: &[f32]| (0..columns * rows).map(|pixel| values[middle(pixel)]).collect();
        Some(DepthMap {
            camera: Camera {
                width: columns as u32,
                height: rows as u32,
                focal: self.camera.focal / by as f64,
                center: self.camera.center / by as f64,
                ..self.camera
            },
            depth: of(&self.depth),
            slope: of(&self.slope),
            color: (0..columns * rows).map(mean).collect(),
        })
    }

    /// Removes depths that are no number or not in front, are farther than `FAR` times the median of all maps, or are
    /// seen at too low an angle.
    pub(super) fn limit(&mut self, median: f32) {
        let (width, camera) = (self.camera.width as usize, self.camera);
        for (i, (depth, slope)) in self.depth.iter_mut().zip(&self.slope).enumerate() {
            let x = ((i % width) as f64 + 0.5 - camera.center.x) / camera.focal.x;
            let y = ((i / width) as f64 + 0.5 - camera.center.y) / camera.focal.y;
            let cosine = slope / (1.0 + x * x + y * y).sqrt() as f32;
            // Written so that NaN fails.
            if !(*depth > 0.0 && *depth <= FAR * median && cosine >= COSINE_MIN) {
                *depth = f32::NAN;
            }
        }
    }
}
