//! Conversion of the oracle's numbers to the kernels' layout.

use crate::layout::WHITEN;
use crate::reference::ScreenSplat;
use crate::reference::gradient::SplatGradients;
use crate::reference::project::{GEOMETRY_PARAMETERS, determinant};
use crate::reference::rasterize_backward::ScreenGradient;

/// The whitening matrix `[[p, 0], [−slope q, q]]` as `(p, q, slope)`: it maps the distance from the centre to residuals
/// of unit variance.
fn whitening(splat: &ScreenSplat<f64>) -> (f64, f64, f64) {
    let [xx, xy, _] = splat.covariance;
    let q = (xx / determinant(splat.covariance)).sqrt();
    (1.0 / xx.sqrt(), q, xy / xx)
}

/// A projected splat, input of compositing; on the device each part has an array of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Splat2d {
    /// Mean in pixels, slope, log2 of the opacity.
    pub shape: [f32; 4],
    /// Whitening factors, red, green.
    pub tone: [f32; 4],
    /// Blue, depth.
    pub rest: [f32; 2],
}

/// The device's arrays: shapes, tones, rests.
pub type Arrays = (Vec<[f32; 4]>, Vec<[f32; 4]>, Vec<[f32; 2]>);

/// Splats in the device's layout.
pub fn arrays(records: &[Splat2d]) -> Arrays {
    (
        records.iter().map(|r| r.shape).collect(),
        records.iter().map(|r| r.tone).collect(),
        records.iter().map(|r| r.rest).collect(),
    )
}

/// A projected splat in double precision: shape, tone; blue and depth first in rest.
pub fn splat2d_values(splat: &ScreenSplat<f64>) -> [[f64; 4]; 3] {
    let (p, q, slope) = whitening(splat);
    let whiten = f64::from(WHITEN);
    let [r, g, b] = splat.color;
    [
        [splat.mean[0], splat.mean[1], slope, splat.opacity.log2()],
        [whiten * p, whiten * q, r, g],
        [b, splat.depth, 0.0, 0.0],
    ]
}

/// [`splat2d_values`] rounded for the device.
pub fn splat2d(splat: &ScreenSplat<f64>) -> Splat2d {
    let [shape, tone, [blue, depth, ..]] = splat2d_values(splat).map(|v| v.map(|x| x as f32));
    Splat2d {
        shape,
        tone,
        rest: [blue, depth],
    }
}

/// The splat decoded from a record.
pub fn screen_splat(record: &Splat2d) -> ScreenSplat<f64> {
    let [shape, tone] = [record.shape, record.tone].map(|v| v.map(f64::from));
    let rest = record.rest.map(f64::from);
    let whiten = f64::from(WHITEN);
    let xx = (whiten / tone[0]).powi(2);
    let y_given_x = (whiten / tone[1]).powi(2);
    let xy = shape[2] * xx;
    ScreenSplat {
        mean: [shape[0], shape[1]],
        covariance: [xx, xy, shape[2] * xy + y_given_x],
        opacity: shape[3].exp2(),
        color: [tone[2], tone[3], rest[0]],
        depth: rest[1],
        disc: None,
    }
}

/// Sums of `rasterize_backward` for a splat (or for one tile of it): with `s = α ∂L/∂α` and the residual
/// `f = WHITEN · e`: `[s, s fx, s fy, s fx fx]`, `[s fx fy, s fy fy, red, green]`, `[blue]`.
///
/// From `∂L/∂mean = Wᵀ Σ s e` and `∂L/∂Σ = ½ Wᵀ (Σ s e eᵀ) W`, solved for the sums.
pub fn whitened_sums(splat: &ScreenSplat<f64>, gradient: &ScreenGradient) -> [f64; 9] {
    let (p, q, slope) = whitening(splat);
    let whiten = f64::from(WHITEN);
    let [d_x, d_y, d_xx, d_xy, d_yy, d_opacity, red, green, blue, _] = gradient.row;
    // Columns of W⁻¹: a residual of 1 along x or y, in pixels.
    let along = [[1.0 / p, slope / p], [0.0, 1.0 / q]];
    let first = along.map(|c| whiten * (c[0] * d_x + c[1] * d_y));
    // d_xy is the sum of both off-diagonal entries.
    let by_covariance =
        |a: [f64; 2], b: [f64; 2]| a[0] * d_xx * b[0] + 0.5 * d_xy * (a[0] * b[1] + a[1] * b[0]) + a[1] * d_yy * b[1];
    let second = |i: usize, j: usize| 2.0 * whiten * whiten * by_covariance(along[i], along[j]);
    let s = splat.opacity * d_opacity;
    [
        s,
        first[0],
        first[1],
        second(0, 0),
        second(0, 1),
        second(1, 1),
        red,
        green,
        blue,
    ]
}

/// Rows of parameters or of their gradients, each ordered like `Splat::parameters`, as planes of four:
/// `[plane][splat]`, the planes `rows.len()` apart.
pub fn planes(rows: &[Vec<f64>]) -> Vec<[f64; 4]> {
    let floats = rows.first().map_or(0, Vec::len);
    let geometry = [[0, 1, 2, 10], [3, 4, 5, 6], [7, 8, 9, usize::MAX]];
    let harmonics = (GEOMETRY_PARAMETERS..floats).step_by(4);
    let places = geometry
        .into_iter()
        .chain(harmonics.map(|start| [0, 1, 2, 3].map(|lane| start + lane)));
    let plane = |lanes: [usize; 4]| {
        let number = |row: &Vec<f64>, place: usize| row.get(place).copied().unwrap_or(0.0);
        rows.iter().map(move |row| lanes.map(|place| number(row, place)))
    };
    places.flat_map(plane).collect()
}

/// Sets the smoothing filters in parameter planes, one per splat.
pub fn set_filters<T: Copy>(planes: &mut [[T; 4]], filters: &[T]) {
    let count = filters.len();
    for (row, &filter) in planes[2 * count..].iter_mut().zip(filters) {
        row[3] = filter;
    }
}

/// A gradient's rows, each ordered like `Splat::parameters`.
pub fn gradient_rows(gradient: &SplatGradients) -> Vec<Vec<f64>> {
    let count = gradient.mean.len();
    let stride = gradient.sh.len() / count.max(1);
    let row = |i: usize| {
        let mut row = gradient.mean[i].to_vec();
        row.extend(gradient.quaternion[i]);
        row.extend(gradient.log_scale[i]);
        row.push(gradient.opacity_logit[i]);
        row.extend(&gradient.sh[i * stride..][..stride]);
        row
    };
    (0..count).map(row).collect()
}

/// Gradient by a splat's screen parameters from its sums: the inverse of [`whitened_sums`].
pub fn screen_row(splat: &ScreenSplat<f64>, sums: [f64; 9]) -> [f64; 10] {
    let [s, x, y, xx, xy, yy, red, green, blue] = sums;
    let (w, (p, q, slope)) = (f64::from(WHITEN), whitening(splat));
    // The gradient by the covariance is W' M W / 2 with W = [[p, 0], [-slope q, q]].
    let (a, b) = (-slope * q, q);
    let half = 0.5 / (w * w);
    let d_xx = half * (p * p * xx + 2.0 * p * a * xy + a * a * yy);
    let d_xy = 2.0 * half * (p * b * xy + a * b * yy);
    let d_yy = half * b * b * yy;
    let mean = [(p * x + a * y) / w, b * y / w];
    [
        mean[0],
        mean[1],
        d_xx,
        d_xy,
        d_yy,
        s / splat.opacity,
        red,
        green,
        blue,
        0.0,
    ]
}

/// Planes of parameters, each in the order of an index.
pub fn in_order(planes: &[[f32; 4]], index: &[u32]) -> Vec<[f32; 4]> {
    planes
        .chunks(index.len())
        .flat_map(|plane| index.iter().map(|&splat| plane[splat as usize]))
        .collect()
}
