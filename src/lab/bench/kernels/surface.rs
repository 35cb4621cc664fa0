//! Planes and surfaces of a composite: as the device reads them, and beside its outputs.

use super::composite::Composite;
use crate::kernels::rasterize::Outputs;
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::lists::viewpoint;
use crate::layout::SURFACE_FIRST;
use crate::reference::linear::{dot, matrix, normalize, rotation, sub, transform, transpose, vector};
use crate::reference::plane::TangentPlane;
use crate::reference::{Splat, Viewpoint, project};

/// A plane in the device's layout.
pub fn packed(plane: &TangentPlane, view: &Viewpoint) -> [f32; 3] {
    let [x, y] = plane.tilt(view);
    let last = match &plane.disc {
        Some(_) => view.dilation,
        None => plane.range,
    };
    [x, y, last].map(|value| value as f32)
}

/// Planes that the device found beside those of the reference.
///
/// With u = 2⁻²⁴, a ray in the splat's axes has an error of 10 u of its length, and a ratio of scales, twice an
/// exponential of 16 ulp, 40 u of itself. Flat splats lose digits as they turn edge-on: the ratios leave little of the
/// ray for their normal, whose relative error grows by 1 / `left`, and that of the tilt by 1 / cos. Compared are the
/// normal times `left`, and the range in units of its own bound, 3 |tilt| |footprint| / cos: 100 u, tripled for the
/// remaining steps.
pub(super) fn plane_outputs(view: &Viewpoint, splats: &[Splat<f64>], found: &[[f64; 3]]) -> Vec<Output> {
    let lens = [view.camera.focal.to_array(), view.camera.center.to_array()];
    let [mut normals, mut ranges] = [(); 2].map(|()| [(); 2].map(|()| Vec::<f64>::new()));
    for (splat, &[x, y, range]) in splats.iter().zip(found) {
        let plane = TangentPlane::of(splat, view);
        if project::margins(splat, view).limit < 1e-5 {
            continue;
        }
        let [mean_x, mean_y] = [0, 1].map(|i| lens[0][i] * plane.mean[i] / plane.mean[2]);
        let normal = normalize([x * lens[0][0], y * lens[0][1], 1.0 - x * mean_x - y * mean_y]);
        let left = left_by_ratios(splat, view);
        normals[0].extend(normal.map(|n| -n * left));
        normals[1].extend(plane.normal.map(|n| n * left));
        let tilt = plane.tilt(view);
        let [xx, _, yy] = project::screen_covariance(splat, view, matrix(view.camera.rotation), plane.mean);
        let cos = -dot(plane.normal, normalize(plane.mean));
        let unit = 3.0 * tilt[0].hypot(tilt[1]) * (xx + yy).sqrt() / cos + 1e-9;
        ranges[0].push(range / unit);
        ranges[1].push(plane.range / unit);
    }
    let [found, expected] = normals;
    let [found_range, expected_range] = ranges;
    vec![
        Output::relative("normal", found, expected, 2e-5, 1.0),
        Output::relative("range", found_range, expected_range, 2e-5, 1.0),
    ]
}

/// Share of the line of sight's length that is left after its components along the splat's axes were multiplied by the
/// squares of (least scale / scale).
fn left_by_ratios(splat: &Splat<f64>, view: &Viewpoint) -> f64 {
    let sight = normalize(sub(splat.mean, vector(view.camera.position)));
    let local = transform(transpose(rotation(splat.quaternion)), sight);
    let least = splat.log_scale.iter().copied().fold(f64::INFINITY, f64::min);
    let squares = (0..3).map(|i| (local[i] * (2.0 * (least - splat.log_scale[i])).exp()).powi(2));
    squares.sum::<f64>().sqrt()
}

impl Composite {
    /// Planes by splat; NaN for splats that are not drawn.
    pub(super) fn packed_planes(&self) -> Vec<[f32; 3]> {
        let view = viewpoint(&self.scene);
        let drawn = self.lists.screen.iter().enumerate();
        let plane = |(i, screen): (usize, &Option<_>)| match screen {
            Some(_) => packed(&TangentPlane::of(&Splat::of(&self.scene.splats, i), &view), &view),
            None => [f32::NAN; 3],
        };
        drawn.map(plane).collect()
    }

    /// Surfaces beside the expected ones, or beside none.
    ///
    /// Weights err as in the image: 2e-5. The depth of a plane divides by 1 + tilt · d, at least 0.1: the rounding of
    /// tilt · d, 3 · 2⁻²⁴ of products of up to 16 px · tilt, whose sum stays in a range of 0.9, becomes a relative
    /// 100 · 2⁻²⁴ · 0.9 in the worst case, within 2e-5 too. A normal's component has the rounding of three numbers as
    /// large as itself, but for planes seen edge-on, where 1 − tilt · (mean − centre) cancels: 1e-4 where planes stand
    /// at up to 89 degrees. The depth of the splat half way jumps to a neighbour's where the coverage is near ½. A
    /// logarithm has the relative errors of its two depths, 4e-5, and up to 1e-4 of itself; the range of the depths is
    /// about e³.
    pub(super) fn surface_outputs(&self, found: &[f32], outputs: Outputs) -> Vec<Output> {
        let pixels = self.pixels.len();
        let planes = |from: usize, to: usize, of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
            let wanted = |plane| outputs.surface && (plane < SURFACE_FIRST as usize || outputs.spread);
            let number = |(plane, pixel)| if wanted(plane) { of(plane, pixel) } else { f64::NAN };
            let places = (from..to).flat_map(|plane| (0..pixels).map(move |pixel| (plane, pixel)));
            places.map(number).collect()
        };
        let part = |from: usize, to: usize| floats(&found[from * pixels..to * pixels]);
        let near = |times: usize| -> Vec<bool> {
            let near: Vec<bool> = self.pixels.iter().map(|pixel| pixel.near).collect();
            near.repeat(times)
        };
        let half_way = self
            .pixels
            .iter()
            .map(|pixel| pixel.near || pixel.surface.margin < 2e-5);
        let range = self.splats.iter().map(|splat| splat.depth).fold(1.0, f64::max);
        let depth = planes(0, 1, &|_, pixel| self.pixels[pixel].surface.depth);
        let median = planes(1, 2, &|_, pixel| self.pixels[pixel].surface.median);
        let normal = planes(2, 5, &|plane, pixel| self.pixels[pixel].surface.normal[plane - 2]);
        let interquartile = planes(5, 6, &|_, pixel| self.pixels[pixel].surface.interquartile);
        let first = planes(6, 7, &|_, pixel| self.pixels[pixel].surface.first);
        let logs = planes(7, 9, &|plane, pixel| {
            let at = &self.pixels[pixel].surface;
            let square = at.spread + at.log * at.log;
            at.coverage * if plane == 7 { at.log } else { square }
        });
        vec![
            Output::relative("first depth", part(6, 7), first, 2e-5, range).near(near(1), range, 0.01),
            Output::relative("logarithms", part(7, 9), logs, 1e-4, 3.0).near(near(2), 10.0, 0.01),
            Output::relative("interquartile depth", part(5, 6), interquartile, 2e-5, range).near(
                near(1),
                range / 255.0,
                0.01,
            ),
            Output::relative("plane depth", part(0, 1), depth, 2e-5, range).near(near(1), range / 255.0, 0.01),
            Output::relative("median depth", part(1, 2), median, 2e-5, range).near(
                half_way.collect(),
                2.0 * range,
                0.01,
            ),
            Output::relative("normal", part(2, 5), normal, 1e-4, 1.0).near(near(3), 1.0 / 255.0, 0.01),
        ]
    }
}
