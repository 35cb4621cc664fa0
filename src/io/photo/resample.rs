//! Undistortion and reduction of photographs.
//!
//! Colours are averaged with alpha as the weight, so that arbitrary colours under transparent pixels do not bleed into
//! visible ones.

use super::SIDE_MIN;
use crate::scene::{Camera, Optics, Photo};
use glam::{DVec2, Vec4};

/// Picture of an ideal pinhole, from a photograph of the size that `optics` has.
///
/// Every pixel centre is a direction, which the lens maps into the photograph, sampled by [`cubic`]. **Border rule:** a
/// pixel with its source outside of the photograph, or beyond the angle at which the lens folds back on itself, becomes
/// transparent black, which the loss ignores.
pub(super) fn undistort(photo: &Photo, optics: &Optics) -> Photo {
    let Camera {
        width,
        height,
        focal,
        center,
        ..
    } = optics.pinhole;
    let reach = optics.lens.reach();
    let mut rgba = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for x in 0..width {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let direction = ((pixel - center) / focal).extend(1.0);
            let source = optics.pixel(direction, reach);
            rgba.push(source.map_or([0; 4], |source| cubic(photo, source)));
        }
    }
    Photo { width, height, rgba }
}

/// Colour at a place between pixel centres, by Keys' cubic convolution (a = -1/2): exact on quadratics, where a
/// bilinear mean blurs.
fn cubic(photo: &Photo, at: DVec2) -> [u8; 4] {
    let (width, height) = (i64::from(photo.width), i64::from(photo.height));
    let base = at - DVec2::splat(0.5);
    let corner = base.floor();
    let fraction = (base - corner).as_vec2();
    let (columns, rows) = (cubic_weights(fraction.x), cubic_weights(fraction.y));
    let mut sum = Vec4::ZERO;
    for (row, row_weight) in (corner.y as i64 - 1..).zip(rows) {
        // Clamp to the border: beyond it there is no neighbour.
        let line = row.clamp(0, height - 1) * width;
        for (column, weight) in (corner.x as i64 - 1..).zip(columns) {
            let pixel = photo.rgba[(line + column.clamp(0, width - 1)) as usize];
            sum += weighted(pixel) * (weight * row_weight);
        }
    }
    unweighted(sum)
}

/// Weights of the pixels at -1, 0, 1 and 2 for a place at `t` from 0 to 1.
fn cubic_weights(t: f32) -> [f32; 4] {
    let u = 1.0 - t;
    [
        -0.5 * t * u * u,
        1.0 + t * t * (1.5 * t - 2.5),
        1.0 + u * u * (1.5 * u - 2.5),
        -0.5 * u * t * t,
    ]
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
    // Negative weights may take sums out of the range; the cast clamps.
    let alpha = sum.w.round() as u8;
    if alpha == 0 {
        return [0; 4];
    }
    let color = sum / sum.w;
    let [r, g, b] = [color.x, color.y, color.z].map(|c| c.round() as u8);
    [r, g, b, alpha]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubic_is_exact_on_a_parabola() {
        let value = |x: f64| 3.0 + 2.0 * (x - 0.5) * (x - 0.5);
        let row = (0..8).map(|x| value(f64::from(x) + 0.5));
        let rgba = row.map(|v| [v as u8, 0, 0, 255]).collect();
        let photo = Photo {
            width: 8,
            height: 1,
            rgba,
        };
        for at in [2.0, 3.25, 4.5, 5.125] {
            let [r, ..] = cubic(&photo, DVec2::new(at, 0.5));
            assert!((f64::from(r) - value(at)).abs() <= 0.5, "{at}: {r}");
        }
    }

    #[test]
    fn cubic_keeps_colours_under_transparency_out() {
        let rgba = [[200, 0, 0, 255]; 3].into_iter().chain([[0, 255, 0, 0]; 3]);
        let photo = Photo {
            width: 6,
            height: 1,
            rgba: rgba.collect(),
        };
        for at in [2.75, 3.0, 3.25] {
            let [r, g, b, a] = cubic(&photo, DVec2::new(at, 0.5));
            assert!(a == 0 || (r, g, b) == (200, 0, 0), "{at}: {r} {g} {b} {a}");
        }
    }
}
