//! Depths and normals of a rendered image.

use crate::layout::{SURFACE_DEPTH, SURFACE_INTERQUARTILE, SURFACE_MEDIAN, SURFACE_NORMAL};
use crate::scene::Camera;
use glam::{DMat3, Vec3};

/// Depth and normal of each pixel, row by row from the top. Each splat counts with the plane of its Gaussian, by its
/// blending weight.
///
/// Pixels covered by less than half (transmittance above ½) have no surface: all their numbers are NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Mean depth along the view's z axis, world units: Σ weight · z / coverage. Between two surfaces at the border of
    /// the nearer one.
    pub expected_depth: Vec<f32>,
    /// Depth of the splat at which the transmittance falls to ½, along the view's z axis, world units. Steps from splat
    /// to splat, but on one surface at borders.
    pub median_depth: Vec<f32>,
    /// Mean depth of the middle half, between transmittances of ¾ and ¼, along the view's z axis, world units: an
    /// interquartile mean. Smooth as the expected depth, but between two surfaces at fewer pixels of a border.
    pub interquartile_depth: Vec<f32>,
    /// Mean normal in the world, of unit length, toward the camera.
    pub normal: Vec<[f32; 3]>,
}

/// Shortest mean normal with a direction: normals that cancel leave rounding, 2⁻²⁴ of each.
const NORMAL_MIN: f32 = 1e-5;

impl Surface {
    /// Appends the rows below.
    pub(super) fn append(&mut self, below: Surface) {
        self.expected_depth.extend(below.expected_depth);
        self.median_depth.extend(below.median_depth);
        self.interquartile_depth.extend(below.interquartile_depth);
        self.normal.extend(below.normal);
    }

    /// True for a pixel with a surface, by its transmittance.
    pub fn is_at(transmittance: f32) -> bool {
        transmittance <= 0.5
    }

    /// Decodes the planes of a device's frame.
    pub(super) fn unpack(camera: &Camera, planes: &[f32], transmittance: &[f32]) -> Surface {
        let pixels = transmittance.len();
        let plane = |index: u32| &planes[index as usize * pixels..][..pixels];
        let (depth, median) = (plane(SURFACE_DEPTH), plane(SURFACE_MEDIAN));
        let interquartile = plane(SURFACE_INTERQUARTILE);
        let [x, y, z] = [0, 1, 2].map(|axis| plane(SURFACE_NORMAL + axis));
        let world_from_view = camera.rotation.transpose();
        let at = |value: f32, pixel: usize| match Surface::is_at(transmittance[pixel]) {
            true => value,
            false => f32::NAN,
        };
        let normal = |i: usize| match Surface::is_at(transmittance[i]) {
            true => unit(world_from_view, [x[i], y[i], z[i]]),
            false => [f32::NAN; 3],
        };
        Surface {
            expected_depth: (0..pixels)
                .map(|i| at(depth[i] / (1.0 - transmittance[i]), i))
                .collect(),
            median_depth: (0..pixels).map(|i| at(median[i], i)).collect(),
            interquartile_depth: (0..pixels)
                .map(|i| at(interquartile[i] / (0.75 - transmittance[i].max(0.25)), i))
                .collect(),
            normal: (0..pixels).map(normal).collect(),
        }
    }
}

/// The direction of a sum of normals in the view, in the world; NaN if they cancel.
fn unit(world_from_view: DMat3, sum: [f32; 3]) -> [f32; 3] {
    let sum = Vec3::from(sum);
    match sum.length() >= NORMAL_MIN {
        true => (world_from_view * sum.as_dvec3()).normalize().as_vec3().to_array(),
        false => [f32::NAN; 3],
    }
}
