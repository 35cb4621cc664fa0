//! Errors of depths and normals of a picture against the true ones.

use crate::stats::{Summary, mean};
use glam::DVec3;
use serde::Serialize;

/// Depths and normals of a picture, row by row from the top.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceImage<'a> {
    /// Width in pixels.
    pub width: usize,
    /// Depth of each pixel along the view's z axis; without a surface infinite, NaN or not above 0.
    pub depth: &'a [f32],
    /// Normal of each pixel, of unit length, toward the camera.
    pub normal: &'a [[f32; 3]],
}

/// Errors over the pixels with a true surface, but for those near its borders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SurfaceScore {
    /// Pixels scored.
    pub pixels: usize,
    /// Share of the pixels with a true surface that lie within two pixels of a border: of the surface, or of a nearer
    /// one by more than a twentieth of the depth. They are not scored.
    pub border_share: f64,
    /// Share of the scored pixels without a surface in the picture; the figures below are of the others.
    pub missing_share: f64,
    /// Mean of |depth − true depth| / true depth.
    pub depth_mean: f64,
    /// Median of the same.
    pub depth_median: f64,
    /// Median of (depth − true depth) / true depth.
    pub depth_bias: f64,
    /// Share of pixels within 1 % of the true depth.
    pub within_percent: f64,
    /// Mean angle between normals, degrees.
    pub normal_mean_deg: f64,
    /// Median of the same.
    pub normal_median_deg: f64,
    /// Share of angles below 11.25°.
    pub within_11_deg: f64,
}

/// Distance from a border within which pixels are not scored, pixels.
const BORDER: usize = 2;

/// Step of depth that is a border, relative to the nearer depth.
const STEP: f32 = 0.05;

impl SurfaceImage<'_> {
    fn has(&self, pixel: usize) -> bool {
        self.depth[pixel].is_finite() && self.depth[pixel] > 0.0
    }

    /// Whether a pixel with a surface is within `BORDER` pixels of a border, in either direction.
    fn is_near_border(&self, pixel: usize) -> bool {
        let (column, row) = (pixel % self.width, pixel / self.width);
        let last = self.depth.len() / self.width - 1;
        let rows = row.saturating_sub(BORDER)..=(row + BORDER).min(last);
        let columns = || column.saturating_sub(BORDER)..=(column + BORDER).min(self.width - 1);
        let mut around = rows.flat_map(|row| columns().map(move |column| row * self.width + column));
        let here = self.depth[pixel];
        around.any(|other| {
            let there = self.depth[other];
            !self.has(other) || (here - there).abs() > STEP * here.min(there)
        })
    }
}

impl SurfaceScore {
    /// Scores a picture; both have the same size.
    pub fn of(found: &SurfaceImage<'_>, truth: &SurfaceImage<'_>) -> SurfaceScore {
        assert_eq!(found.depth.len(), truth.depth.len(), "image sizes");
        let surface: Vec<usize> = (0..truth.depth.len()).filter(|&pixel| truth.has(pixel)).collect();
        let inner: Vec<usize> = surface.iter().copied().filter(|&p| !truth.is_near_border(p)).collect();
        let met: Vec<usize> = inner.iter().copied().filter(|&pixel| found.has(pixel)).collect();
        let relative = |&pixel: &usize| f64::from(found.depth[pixel]) / f64::from(truth.depth[pixel]) - 1.0;
        let bias: Vec<f64> = met.iter().map(relative).collect();
        let error: Vec<f64> = bias.iter().map(|error| error.abs()).collect();
        let angle: Vec<f64> = met
            .iter()
            .map(|&pixel| degrees_between(found.normal[pixel], truth.normal[pixel]))
            .collect();
        SurfaceScore {
            pixels: inner.len(),
            border_share: share(surface.len() - inner.len(), surface.len()),
            missing_share: share(inner.len() - met.len(), inner.len()),
            depth_mean: mean(&error),
            depth_median: median(&error),
            depth_bias: median(&bias),
            within_percent: share_below(&error, 0.01),
            normal_mean_deg: mean(&angle),
            normal_median_deg: median(&angle),
            within_11_deg: share_below(&angle, 11.25),
        }
    }

    /// Mean of the scores of several views, each with the same weight; pixels are summed.
    pub fn average(scores: &[SurfaceScore]) -> SurfaceScore {
        let mean = |of: fn(&SurfaceScore) -> f64| mean(&scores.iter().map(of).collect::<Vec<_>>());
        SurfaceScore {
            pixels: scores.iter().map(|score| score.pixels).sum(),
            border_share: mean(|s| s.border_share),
            missing_share: mean(|s| s.missing_share),
            depth_mean: mean(|s| s.depth_mean),
            depth_median: mean(|s| s.depth_median),
            depth_bias: mean(|s| s.depth_bias),
            within_percent: mean(|s| s.within_percent),
            normal_mean_deg: mean(|s| s.normal_mean_deg),
            normal_median_deg: mean(|s| s.normal_median_deg),
            within_11_deg: mean(|s| s.within_11_deg),
        }
    }
}

/// Angle between two directions, degrees; 90 where either has no length, as of normals that cancel.
fn degrees_between(a: [f32; 3], b: [f32; 3]) -> f64 {
    let [a, b] = [a, b].map(|normal| DVec3::from(normal.map(f64::from)));
    match (a.cross(b).length(), a.dot(b)) {
        (0.0, 0.0) => 90.0,
        (sine, cosine) => sine.atan2(cosine).to_degrees(),
    }
}

fn share(part: usize, whole: usize) -> f64 {
    part as f64 / whole.max(1) as f64
}

fn share_below(values: &[f64], limit: f64) -> f64 {
    share(values.iter().filter(|value| **value < limit).count(), values.len())
}

fn median(values: &[f64]) -> f64 {
    Summary::of(values).median
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 12;

    /// A picture of `pixels` with normals along -z turned by `degrees` about x.
    fn picture(pixels: impl Fn(usize, usize) -> f32, degrees: f32) -> (Vec<f32>, Vec<[f32; 3]>) {
        let depth: Vec<f32> = (0..WIDTH * WIDTH).map(|i| pixels(i % WIDTH, i / WIDTH)).collect();
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let normal = vec![[0.0, sine, -cosine]; depth.len()];
        (depth, normal)
    }

    fn score(found: &(Vec<f32>, Vec<[f32; 3]>), truth: &(Vec<f32>, Vec<[f32; 3]>)) -> SurfaceScore {
        let [found, truth] = [found, truth].map(|(depth, normal)| SurfaceImage {
            width: WIDTH,
            depth,
            normal,
        });
        SurfaceScore::of(&found, &truth)
    }

    #[test]
    fn errors_are_those_of_the_depths_and_normals() {
        let truth = picture(|_, _| 2.0, 0.0);
        assert_eq!(score(&truth, &truth).depth_mean, 0.0);
        // A quarter of the rows 2 % too far, the others 0.5 % too near, and normals off by 5 degrees.
        let off = picture(|_, row| if row < WIDTH / 4 { 2.04 } else { 1.99 }, 5.0);
        let found = score(&off, &truth);
        assert_eq!(found.pixels, WIDTH * WIDTH);
        assert!(
            (found.depth_mean - (0.25 * 0.02 + 0.75 * 0.005)).abs() < 1e-6,
            "{found:?}"
        );
        assert!((found.depth_median - 0.005).abs() < 1e-6 && (found.depth_bias + 0.005).abs() < 1e-6);
        assert!((found.within_percent - 0.75).abs() < 1e-9);
        assert!(
            (found.normal_mean_deg - 5.0).abs() < 1e-4 && found.within_11_deg == 1.0,
            "{found:?}"
        );
        assert_eq!(score(&picture(|_, _| 2.0, 20.0), &truth).within_11_deg, 0.0);
        let no_normals = (truth.0.clone(), vec![[0.0; 3]; WIDTH * WIDTH]);
        assert_eq!(score(&no_normals, &truth).normal_mean_deg, 90.0);
    }

    #[test]
    fn borders_are_left_out_and_holes_are_counted() {
        // Sky on the left, a nearer surface on the right: of eight columns, two beside each border are left out.
        let column = |column: usize, _| match column {
            0 | 1 => f32::INFINITY,
            2..=9 => 4.0,
            _ => 3.0,
        };
        let truth = picture(column, 0.0);
        let holed = picture(|x, y| if x == 5 { f32::NAN } else { column(x, y) }, 0.0);
        let found = score(&holed, &truth);
        assert_eq!(found.pixels, 4 * WIDTH);
        assert!((found.border_share - 0.6).abs() < 1e-9, "{found:?}");
        assert!((found.missing_share - 0.25).abs() < 1e-9, "{found:?}");
        assert_eq!(found.depth_mean, 0.0);
        let both = SurfaceScore::average(&[found, score(&truth, &truth)]);
        assert!((both.missing_share - 0.125).abs() < 1e-9 && both.pixels == 8 * WIDTH);
    }
}
