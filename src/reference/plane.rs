//! TangentPlane of a splat, and depth and normal of a pixel.
//!
//! Where a splat is made round, by the inverse of its scales and rotation, its contours are spheres, and the plane
//! through its centre across the line of sight is tangent to them in the middle. Two directions of that plane, carried
//! back, span the splat's plane: no inverse covariance, and no derivative. A surfel lies in its plane.

use super::linear::{Vec3, add, cross, dot, normalize, rotation, scale, sub, transform, transpose, vector};
use super::rasterize::weights;
use super::surfel::{SurfelDisc, filtered, normal_toward};
use super::{Real, ScreenSplat, Splat, Thresholds, Viewpoint};
use crate::reference::linear::matrix;
use crate::reference::project::{screen_covariance, surfel_of};
use crate::scene::Primitive;

/// A splat's plane in the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentPlane<R = f64> {
    /// The splat's mean in the view, world units.
    pub mean: Vec3<R>,
    /// Unit normal, toward the camera.
    pub normal: Vec3<R>,
    /// Largest |z₀ / z − 1|; a constant.
    pub range: f64,
    /// Change of z₀ / z from pixel to pixel under the mip filter of surfels.
    pub filtered: Option<[R; 2]>,
    /// The surfel, if it is one.
    pub disc: Option<SurfelDisc<R>>,
}

/// Largest [`TangentPlane::range`].
pub const RANGE_MAX: f64 = 0.9;

impl<R: Real> TangentPlane<R> {
    /// The plane of a splat in front of the camera.
    pub fn of(splat: &Splat<R>, view: &Viewpoint) -> TangentPlane<R> {
        let from_camera = sub(splat.mean, vector(view.camera.position));
        let view_from_world = matrix(view.camera.rotation);
        let axes = rotation(splat.quaternion);
        if view.primitive == Primitive::Surfel {
            let disc = surfel_of(splat, transform(view_from_world, from_camera), view);
            // Edge-on it is a spot parallel to the picture.
            let normal = if disc.is_edge_on {
                [0.0, 0.0, 1.0].map(R::of)
            } else {
                disc.normal
            };
            let plane = TangentPlane {
                mean: disc.mean,
                normal: normal_toward(normal, disc.mean),
                range: RANGE_MAX,
                filtered: None,
                disc: Some(disc),
            };
            return if disc.has_spot {
                plane
            } else {
                plane.under_filter(splat, view)
            };
        }
        let scales = splat.log_scale.map(R::exp);
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
            normal: normal_toward(normal, mean),
            range: RANGE_MAX,
            filtered: None,
            disc: None,
        };
        let tilt = plane.tilt(view).map(R::value);
        let [xx, xy, yy] = screen_covariance(splat, view, view_from_world, mean).map(R::value);
        let variance = tilt[0] * tilt[0] * xx + 2.0 * tilt[0] * tilt[1] * xy + tilt[1] * tilt[1] * yy;
        plane.range = (3.0 * variance.sqrt()).min(RANGE_MAX);
        plane
    }

    /// The plane with its tilt under the screen's filter.
    fn under_filter(self, splat: &Splat<R>, view: &Viewpoint) -> TangentPlane<R> {
        let [xx, xy, yy] = screen_covariance(splat, view, matrix(view.camera.rotation), self.mean);
        let k = R::of(view.dilation);
        let tilt = filtered(self.tilt(view), [xx + k, xy, yy + k], view.dilation);
        TangentPlane {
            filtered: Some(tilt),
            ..self
        }
    }

    /// Pixel of the mean.
    fn center(&self, view: &Viewpoint) -> [R; 2] {
        let (focal, center) = (view.camera.focal.to_array(), view.camera.center.to_array());
        [0, 1].map(|i| R::of(focal[i]) * self.mean[i] / self.mean[2] + R::of(center[i]))
    }

    /// Change of z₀ / z from pixel to pixel, in x and in y: it is linear.
    pub fn tilt(&self, view: &Viewpoint) -> [R; 2] {
        let at = self.center(view);
        [[1.0, 0.0], [0.0, 1.0]].map(|step| {
            let beside = [at[0] + R::of(step[0]), at[1] + R::of(step[1])];
            self.inverse_depth(beside, view) * self.mean[2] - R::of(1.0)
        })
    }

    /// 1 / z where the ray through a position (pixels) meets the plane.
    fn inverse_depth(&self, position: [R; 2], view: &Viewpoint) -> R {
        let camera = &view.camera;
        let (focal, center) = (camera.focal.to_array().map(R::of), camera.center.to_array().map(R::of));
        let ray = [
            (position[0] - center[0]) / focal[0],
            (position[1] - center[1]) / focal[1],
            R::of(1.0),
        ];
        dot(self.normal, ray) / dot(self.normal, self.mean)
    }

    /// Depth of the plane at a position (pixels), within the splat's range; world units along z.
    pub fn depth(&self, position: [f64; 2], view: &Viewpoint) -> R {
        let z = self.mean[2];
        if let Some(tilt) = self.filtered {
            let at = self.center(view);
            let change = |i: usize| tilt[i] * (R::of(position[i]) - at[i]);
            return z / (R::of(1.0) + change(0) + change(1));
        }
        if let Some(disc) = &self.disc {
            return disc.depth(position);
        }
        let tilt = self.inverse_depth(position.map(R::of), view) * z - R::of(1.0);
        z / (R::of(1.0) + tilt.at_least(-self.range).at_most(self.range))
    }
}

/// Two unit vectors that are at right angles to `v` and to each other.
fn across<R: Real>(v: Vec3<R>) -> [Vec3<R>; 2] {
    let size = |i: usize| v[i].value().abs();
    let least = (0..3).fold(0, |m, i| if size(i) < size(m) { i } else { m });
    let mut axis = [R::of(0.0); 3];
    axis[least] = R::of(1.0);
    let first = normalize(cross(v, axis));
    [first, cross(v, first)]
}

/// Depth and normal of a pixel, not divided by the coverage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePixel<R = f64> {
    /// Σ weight, the coverage.
    pub coverage: R,
    /// Σ weight · z, world units.
    pub depth: R,
    /// Depth of the splat at which the coverage reaches ½; 0 if it does not.
    pub median: R,
    /// Σ part · z, with the part of each weight between coverages of ¼ and ¾; world units.
    pub interquartile: R,
    /// Σ weight · normal in the view.
    pub normal: Vec3<R>,
    /// Depth of the first splat, 0 without one.
    pub first: R,
    /// Variance of ln z over the weights: Σ over pairs of wᵢ wⱼ (ln zᵢ − ln zⱼ)² / coverage²; 0 without a splat.
    pub spread: R,
    /// Mean of ln z over the weights, relative to the first splat; 0 without a splat.
    pub log: R,
    /// Least |coverage − ½| before or behind a splat: how near the median is to that of another splat.
    pub margin: f64,
}

/// A coverage, held between the quartiles.
fn within_quartiles<R: Real>(coverage: R) -> R {
    match coverage.value() {
        low if low < 0.25 => R::of(0.25),
        high if high > 0.75 => R::of(0.75),
        _ => coverage,
    }
}

/// The surface of a pixel over splats in the given order, nearest first.
pub fn surface<R: Real>(
    splats: &[ScreenSplat<R>],
    planes: &[TangentPlane<R>],
    order: &[usize],
    position: [f64; 2],
    thresholds: &Thresholds,
    view: &Viewpoint,
) -> SurfacePixel<R> {
    let zero = R::of(0.0);
    let mut pixel = SurfacePixel {
        coverage: zero,
        depth: zero,
        median: zero,
        interquartile: zero,
        normal: [zero; 3],
        first: zero,
        spread: zero,
        log: zero,
        margin: 0.5,
    };
    let mut logs: Vec<(R, R)> = Vec::new();
    for (index, weight) in weights(splats, order, position, thresholds) {
        let z = planes[index].depth(position, view);
        pixel.depth = pixel.depth + weight * z;
        pixel.normal = add(pixel.normal, scale(weight, planes[index].normal));
        let behind = pixel.coverage + weight;
        if pixel.coverage.value() < 0.5 && behind.value() >= 0.5 {
            pixel.median = z;
        }
        pixel.interquartile = pixel.interquartile + (within_quartiles(behind) - within_quartiles(pixel.coverage)) * z;
        if logs.is_empty() {
            pixel.first = z;
        }
        logs.push((weight, (z / pixel.first).ln()));
        pixel.coverage = behind;
        pixel.margin = pixel.margin.min((pixel.coverage.value() - 0.5).abs());
    }
    if !logs.is_empty() {
        let pairs = logs
            .iter()
            .enumerate()
            .flat_map(|(i, a)| logs[..i].iter().map(move |b| (a, b)));
        let apart = |(a, b): (&(R, R), &(R, R))| a.0 * b.0 * (a.1 - b.1).squared();
        pixel.spread = pairs.map(apart).sum::<R>() / pixel.coverage.squared();
        pixel.log = logs.iter().map(|&(weight, log)| weight * log).sum::<R>() / pixel.coverage;
    }
    pixel
}
