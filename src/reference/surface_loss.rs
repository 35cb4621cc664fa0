//! Terms of geometry: consistency of a frame's normals with its depths, and spread of the depths in its pixels.
//!
//! Each pixel is a point in the view, at the depth of its surface. Where a pixel and its four neighbours have one, and
//! are not of different surfaces, the vectors from neighbour to neighbour span the plane of the depths; its normal is
//! held against the mean normal of the splats. Derivatives follow from duals.

use super::frame::{center, project_all, sorted};
use super::linear::{Vec3, cross, dot, normalize, scale, sub};
use super::plane::{SurfacePixel, TangentPlane, surface};
use super::project::GEOMETRY_PARAMETERS;
use super::{Dual, Options, Real, Splat, Viewpoint};
use crate::scene::Camera;
use rayon::prelude::*;

/// Largest step of depth to a neighbour, in footprints: depth / focal length.
pub const SLOPE_LIMIT: f64 = 6.0;

/// Smallest length of the sum of normals, as a share of the coverage.
pub const NORMAL_MIN: f64 = 0.1;

/// Weights of a pixel's terms in the loss.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceWeights {
    /// Of coverage · (1 − normal · normal of the depths), the coverage a constant.
    pub normal: f64,
    /// Of coverage · variance of ln z, the coverage a constant.
    pub spread: f64,
}

/// Depth of a pixel's surface, if half of it is covered.
fn depth<R: Real>(pixel: &SurfacePixel<R>) -> Option<R> {
    (pixel.coverage.value() >= 0.5).then(|| pixel.depth / pixel.coverage)
}

/// 1 − cosine of the angle between the normal of a pixel and that of the depths around it; `None` where there is none.
/// `at` gives the surface of each pixel of the camera, rows from the top.
pub fn inconsistency<R: Real>(at: impl Fn(usize) -> SurfacePixel<R>, camera: &Camera, pixel: usize) -> Option<R> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let (x, y) = (pixel % width, pixel / width);
    if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height {
        return None;
    }
    let here = at(pixel);
    let z = depth(&here)?;
    let place = |index: usize, focal: f64| -> Option<Vec3<R>> {
        let beside = depth(&at(index))?;
        let is_near = (beside.value() - z.value()).abs() * focal <= SLOPE_LIMIT * z.value();
        let [x, y] = center(index, width);
        let [x, y] = [
            (x - camera.center.x) / camera.focal.x,
            (y - camera.center.y) / camera.focal.y,
        ];
        is_near.then(|| scale(beside, [x, y, 1.0].map(R::of)))
    };
    let down = sub(
        place(pixel + width, camera.focal.y)?,
        place(pixel - width, camera.focal.y)?,
    );
    let across = sub(place(pixel + 1, camera.focal.x)?, place(pixel - 1, camera.focal.x)?);
    let length = dot(here.normal, here.normal).value().sqrt();
    let has_normal = length >= NORMAL_MIN * here.coverage.value();
    has_normal.then(|| R::of(1.0) - dot(normalize(here.normal), normalize(cross(down, across))))
}

/// The terms of one pixel.
pub fn pixel_loss<R: Real>(
    at: impl Fn(usize) -> SurfacePixel<R>,
    camera: &Camera,
    weights: SurfaceWeights,
    pixel: usize,
) -> R {
    let here = at(pixel);
    let coverage = here.coverage.value();
    let normal = inconsistency(&at, camera, pixel).map_or(R::of(0.0), |term| R::of(weights.normal * coverage) * term);
    match coverage >= 0.5 {
        true => normal + R::of(weights.spread * coverage) * here.spread,
        false => normal,
    }
}

/// Sum of the terms of a frame of splats.
pub fn surface_loss<R: Real>(splats: &[Splat<R>], view: &Viewpoint, options: &Options, weights: SurfaceWeights) -> R {
    let (list, splat_from_rank) = sorted(&project_all(splats, view));
    let planes: Vec<TangentPlane<R>> = splat_from_rank
        .iter()
        .map(|&i| TangentPlane::of(&splats[i], view))
        .collect();
    let order: Vec<usize> = (0..list.len()).collect();
    let camera = &view.camera;
    let width = camera.width as usize;
    let pixel = |i: usize| surface(&list, &planes, &order, center(i, width), &options.thresholds, view);
    let count = width * camera.height as usize;
    let pixels: Vec<SurfacePixel<R>> = (0..count).into_par_iter().map(pixel).collect();
    (0..count)
        .map(|i| pixel_loss(|at| pixels[at], camera, weights, i))
        .sum()
}

/// Derivatives of [`surface_loss`] by the geometry of each splat: the first numbers of [`Splat::parameters`].
pub fn surface_loss_backward(
    splats: &[Splat<f64>],
    view: &Viewpoint,
    options: &Options,
    weights: SurfaceWeights,
) -> Vec<[f64; GEOMETRY_PARAMETERS]> {
    let constant = |splat: &Splat<f64>| -> Splat<Dual<GEOMETRY_PARAMETERS>> {
        let row: Vec<_> = splat.parameters().into_iter().map(Dual::of).collect();
        Splat::from_parameters(&row)
    };
    let mut lifted: Vec<Splat<Dual<GEOMETRY_PARAMETERS>>> = splats.iter().map(constant).collect();
    let derivative = |(i, splat): (usize, &Splat<f64>)| {
        let row: Vec<_> = splat.parameters();
        let variables: Vec<_> = (0..row.len()).map(|k| Dual::variable(row[k], Some(k))).collect();
        let before = std::mem::replace(&mut lifted[i], Splat::from_parameters(&variables));
        let loss = surface_loss(&lifted, view, options, weights);
        lifted[i] = before;
        loss.d
    };
    splats.iter().enumerate().map(derivative).collect()
}
