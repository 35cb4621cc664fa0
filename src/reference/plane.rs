//! TangentPlane of a splat, and depth and normal of a pixel.
//!
//! Where a splat is made round, by the inverse of its scales and rotation, its contours are spheres, and the plane
//! through its centre across the line of sight is tangent to them in the middle. Two directions of that plane, carried
//! back, span the splat's plane: no inverse covariance, and no derivative. A surfel lies in its plane.

use super::linear::{Vec3, add, dot, normalize, rotation, scale, sub, transform, transpose, vector};
use super::rasterize::weights;
use super::surfel::{SurfelDisc, normal_toward};
use super::{ScreenSplat, Splat, Thresholds, Viewpoint};
use crate::reference::linear::matrix;
use crate::reference::project::{screen_covariance, surfel_of};
use crate::scene::Primitive;

/// A splat's plane in the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentPlane {
    /// The splat's mean in the view, world units.
    pub mean: Vec3<f64>,
    /// Unit normal, toward the camera.
    pub normal: Vec3<f64>,
    /// Largest |z₀ / z − 1|.
    pub range: f64,
    /// The surfel, if it is one.
    pub disc: Option<SurfelDisc<f64>>,
}

/// Largest [`TangentPlane::range`].
pub const RANGE_MAX: f64 = 0.9;

impl TangentPlane {
    /// The plane of a splat in front of the camera.
    pub fn of(splat: &Splat<f64>, view: &Viewpoint) -> TangentPlane {
        let from_camera = sub(splat.mean, vector(view.camera.position));
        let view_from_world = matrix(view.camera.rotation);
        let axes = rotation(splat.quaternion);
        if view.primitive == Primitive::Surfel {
            let disc = surfel_of(splat, transform(view_from_world, from_camera), view);
            // Edge-on it is a spot parallel to the picture.
            let normal = if disc.is_edge_on { [0.0, 0.0, 1.0] } else { disc.normal };
            return TangentPlane {
                mean: disc.mean,
                normal: normal_toward(normal, disc.mean),
                range: RANGE_MAX,
                disc: Some(disc),
            };
        }
        let scales = splat.log_scale.map(f64::exp);
        let local = transform(transpose(axes), from_camera);
        let sight = normalize([local[0] / scales[0], local[1] / scales[1], local[2] / scales[2]]);
        let directions = across(sight).map(|d| {
            let stretched = [d[0] * scales[0], d[1] * scales[1], d[2] * scales[2]];
            normalize(transform(view_from_world, transform(axes, stretched)))
        });
        let mean = transform(view_from_world, from_camera);
        let normal = normalize(cross(directions[0], directions[1]));
        let mut plane = TangentPlane {
            mean,
            normal: scale(-dot(normal, mean).signum(), normal),
            range: RANGE_MAX,
            disc: None,
        };
        let tilt = plane.tilt(view);
        let [xx, xy, yy] = screen_covariance(splat, view, view_from_world, mean);
        let variance = tilt[0] * tilt[0] * xx + 2.0 * tilt[0] * tilt[1] * xy + tilt[1] * tilt[1] * yy;
        plane.range = (3.0 * variance.sqrt()).min(RANGE_MAX);
        plane
    }

    /// Change of z₀ / z from pixel to pixel, in x and in y: it is linear.
    pub fn tilt(&self, view: &Viewpoint) -> [f64; 2] {
        let camera = &view.camera;
        let [x, y, z] = self.mean;
        let at = [
            camera.focal.x * x / z + camera.center.x,
            camera.focal.y * y / z + camera.center.y,
        ];
        [[1.0, 0.0], [0.0, 1.0]].map(|step| self.inverse_depth([at[0] + step[0], at[1] + step[1]], view) * z - 1.0)
    }

    /// 1 / z where the ray through a position (pixels) meets the plane.
    fn inverse_depth(&self, position: [f64; 2], view: &Viewpoint) -> f64 {
        let camera = &view.camera;
        let ray = [
            (position[0] - camera.center.x) / camera.focal.x,
            (position[1] - camera.center.y) / camera.focal.y,
            1.0,
        ];
        dot(self.normal, ray) / dot(self.normal, self.mean)
    }

    /// Depth of the plane at a position (pixels), within the splat's range; world units along z.
    pub fn depth(&self, position: [f64; 2], view: &Viewpoint) -> f64 {
        if let Some(disc) = &self.disc {
            return disc.depth(position);
        }
        let z = self.mean[2];
        let tilt = self.inverse_depth(position, view) * z - 1.0;
        z / (1.0 + tilt.clamp(-self.range, self.range))
    }
}

/// Two unit vectors that are at right angles to `v` and to each other.
fn across(v: Vec3<f64>) -> [Vec3<f64>; 2] {
    let least = (0..3).fold(0, |m, i| if v[i].abs() < v[m].abs() { i } else { m });
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let first = normalize(cross(v, axis));
    [first, cross(v, first)]
}

/// Vector product.
fn cross(a: Vec3<f64>, b: Vec3<f64>) -> Vec3<f64> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Depth and normal of a pixel, not divided by the coverage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePixel {
    /// Σ weight · z, world units.
    pub depth: f64,
    /// Depth of the splat at which the coverage reaches ½; 0 if it does not.
    pub median: f64,
    /// Σ weight · normal in the view.
    pub normal: Vec3<f64>,
    /// Least |coverage − ½| before or behind a splat: how near the median is to that of another splat.
    pub margin: f64,
}

/// The surface of a pixel over splats in the given order, nearest first.
pub fn surface(
    splats: &[ScreenSplat<f64>],
    planes: &[TangentPlane],
    order: &[usize],
    position: [f64; 2],
    thresholds: &Thresholds,
    view: &Viewpoint,
) -> SurfacePixel {
    let mut pixel = SurfacePixel {
        depth: 0.0,
        median: 0.0,
        normal: [0.0; 3],
        margin: 0.5,
    };
    let mut coverage = 0.0;
    for (index, weight) in weights(splats, order, position, thresholds) {
        let z = planes[index].depth(position, view);
        pixel.depth += weight * z;
        pixel.normal = add(pixel.normal, scale(weight, planes[index].normal));
        let behind = coverage + weight;
        if coverage < 0.5 && behind >= 0.5 {
            pixel.median = z;
        }
        coverage = behind;
        pixel.margin = pixel.margin.min((coverage - 0.5).abs());
    }
    pixel
}
