//! Undistortion and reduction of photographs.
//!
//! Colours are averaged with alpha as the weight, so that arbitrary colours under transparent pixels do not bleed into
//! visible ones.

use super::SIDE_MIN;
use crate::scene::{Camera, Distortion, Photo};
use glam::{DVec2, Vec4};

/// Photograph of an ideal pinhole with the intrinsics of `camera`.
///
/// Every pixel centre is mapped through the distortion and sampled bilinearly. **Border rule:** a pixel with its source
/// outside of the photograph, or beyond the radius at which the distortion polynomial folds back on itself, becomes
/// transparent black, which the loss ignores.
pub(super) fn undistort(photo: &Photo, camera: &Camera, distortion: &Distortion) -> Photo {
    let size = DVec2::new(f64::from(photo.width), f64::from(photo.height));
    let fold = fold_radius_squared(distortion);
    let mut rgba = Vec::with_capacity(photo.rgba.len());
    for y in 0..photo.height {
        for x in 0..photo.width {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ideal = (pixel - camera.center) / camera.focal;
            let source = distort(ideal, distortion) * camera.focal + camera.center;
            let inside = source.cmpge(DVec2::ZERO).all() && source.cmplt(size).all();
            rgba.push(if inside && ideal.length_squared() < fold {
                bilinear(photo, source)
            } else {
                [0; 4]
            });
        }
    }
    Photo { rgba, ..*photo }
}

/// OpenCV's radial–tangential model, on the plane at depth 1.
fn distort(p: DVec2, distortion: &Distortion) -> DVec2 {
    let Distortion { k1, k2, p1, p2 } = *distortion;
    let r2 = p.length_squared();
    let radial = 1.0 + r2 * (k1 + r2 * k2);
    let xy = 2.0 * p.x * p.y;
    p * radial
        + DVec2::new(
            p1 * xy + p2 * (r2 + 2.0 * p.x * p.x),
            p2 * xy + p1 * (r2 + 2.0 * p.y * p.y),
        )
}

/// The squared radius up to which r (1 + k1 r² + k2 r⁴) grows: the first positive root of its
/// derivative 1 + 3 k1 s + 5 k2 s² in s = r².
fn fold_radius_squared(distortion: &Distortion) -> f64 {
    let (a, b) = (5.0 * distortion.k2, 3.0 * distortion.k1);
    let discriminant = b * b - 4.0 * a;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    // Roots of a s² + b s + 1 as 2 / (-b ∓ √…), exact for a = 0, too.
    let root = discriminant.sqrt();
    [2.0 / (-b - root), 2.0 / (-b + root)]
        .into_iter()
        .filter(|s| *s > 0.0)
        .fold(f64::INFINITY, f64::min)
}

fn bilinear(photo: &Photo, at: DVec2) -> [u8; 4] {
    let (width, height) = (i64::from(photo.width), i64::from(photo.height));
    let base = at - DVec2::splat(0.5);
    let corner = base.floor();
    let fraction = (base - corner).as_vec2();
    let (x, y) = (corner.x as i64, corner.y as i64);
    let mut sum = Vec4::ZERO;
    for (dx, dy, weight) in [
        (0, 0, (1.0 - fraction.x) * (1.0 - fraction.y)),
        (1, 0, fraction.x * (1.0 - fraction.y)),
        (0, 1, (1.0 - fraction.x) * fraction.y),
        (1, 1, fraction.x * fraction.y),
    ] {
        // Clamp to the border: within half a pixel of it there is no neighbour.
        let column = (x + dx).clamp(0, width - 1);
        let row = (y + dy).clamp(0, height - 1);
        sum += weighted(photo.rgba[(row * width + column) as usize]) * weight;
    }
    unweighted(sum)
}

/// Half a width or height, rounded up, at least [`SIDE_MIN`] or the whole length if that is less.
pub fn half(length: u32) -> u32 {
    length.div_ceil(2).max(SIDE_MIN).min(length)
}

/// Photograph at `width` x `height`, each pixel the average over its area.
pub fn reduce(photo: Photo, width: u32, height: u32) -> Photo {
    if (photo.width, photo.height) == (width, height) {
        return photo;
    }
    let columns = spans(photo.width, width);
    let rows = spans(photo.height, height);
    let mut rgba = Vec::with_capacity(width as usize * height as usize);
    let mut sums = vec![Vec4::ZERO; width as usize];
    for row in &rows {
        sums.fill(Vec4::ZERO);
        for (y, row_weight) in row.weights() {
            let source = &photo.rgba[y * photo.width as usize..][..photo.width as usize];
            for (sum, column) in sums.iter_mut().zip(&columns) {
                for (x, weight) in column.weights() {
                    *sum += weighted(source[x]) * (weight * row_weight);
                }
            }
        }
        rgba.extend(sums.iter().map(|sum| unweighted(*sum)));
    }
    Photo { width, height, rgba }
}

/// Source pixels under one target pixel: an interval in source pixels.
struct Span {
    start: f64,
    end: f64,
    limit: usize,
}

impl Span {
    /// Source indices with their share of the interval.
    fn weights(&self) -> impl Iterator<Item = (usize, f32)> {
        let (start, end) = (self.start, self.end);
        let last = (end.ceil() as usize).min(self.limit);
        (start as usize..last).filter_map(move |i| {
            let overlap = end.min(i as f64 + 1.0) - start.max(i as f64);
            (overlap > 0.0).then_some((i, (overlap / (end - start)) as f32))
        })
    }
}

fn spans(source: u32, target: u32) -> Vec<Span> {
    let step = f64::from(source) / f64::from(target);
    (0..target)
        .map(|i| Span {
            start: f64::from(i) * step,
            end: f64::from(i + 1) * step,
            limit: source as usize,
        })
        .collect()
}

/// Colour times alpha, and alpha.
fn weighted(pixel: [u8; 4]) -> Vec4 {
    let [r, g, b, a] = pixel.map(f32::from);
    Vec4::new(r * a, g * a, b * a, a)
}

/// The inverse of [`weighted`], rounded.
fn unweighted(sum: Vec4) -> [u8; 4] {
    let alpha = sum.w.round() as u8;
    if alpha == 0 {
        return [0; 4];
    }
    let color = sum / sum.w;
    let [r, g, b] = [color.x, color.y, color.z].map(|c| c.round() as u8);
    [r, g, b, alpha]
}
