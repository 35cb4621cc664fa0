//! Exact perspective: splats evaluated along rays instead of through the linear projection at their means, to measure
//! the error of EWA splatting, the model of the engine.
//!
//! Along a ray `t d`, a splat's alpha is `opacity · exp(−½ min (t d − m)ᵀ Σ⁻¹ (t d − m))` over `t > 0`: its greatest
//! density, with linear projection as the limit for splats small beside their distance. So that nothing but the
//! projection differs, the dilation on the screen is made part of the splat, as the flat Gaussian `dilation · J⁺ J⁺ᵀ`
//! that projects to it (`J⁺` is the pseudo-inverse of the projection's derivative `J` at the mean); opacity, colour and
//! order are those of EWA.

use super::frame::{center, project_all, sorted};
use super::linear::{covariance, dot, matrix, product, sub, transform, transpose, vector};
use super::rasterize::{Layer, composite};
use super::{Options, ScreenSplat, Splat, Thresholds, Viewpoint};
use crate::scene::{Camera, Splats};
use rayon::prelude::*;

/// A splat in view space.
struct Solid {
    screen: ScreenSplat<f64>,
    mean_view: [f64; 3],
    /// Inverse of the covariance in the view, dilation included.
    inverse: [[f64; 3]; 3],
}

/// Colours of some pixels, given by their indices `y * width + x`; `options.thresholds` are ignored.
pub fn colors(splats: &Splats, camera: &Camera, options: &Options, pixels: &[usize]) -> Vec<[f64; 3]> {
    let view = Viewpoint::on(splats, camera, options);
    let all = Splat::<f64>::all(splats);
    let (list, splat_from_rank) = sorted(&project_all(&all, &view));
    let solids: Vec<Solid> = list
        .iter()
        .zip(&splat_from_rank)
        .map(|(screen, &splat)| solid(&all[splat], *screen, &view))
        .collect();
    let color = |&pixel: &usize| {
        let [x, y] = center(pixel, camera.width as usize);
        let direction = [
            (x - camera.center.x) / camera.focal.x,
            (y - camera.center.y) / camera.focal.y,
            1.0,
        ];
        let layers = solids.iter().filter_map(|solid| layer(solid, direction));
        composite(layers, options.background, 0.0).0.color
    };
    pixels.par_iter().map(color).collect()
}

fn layer(solid: &Solid, direction: [f64; 3]) -> Option<Layer<f64>> {
    let weighted = transform(solid.inverse, direction);
    let nearest = dot(weighted, solid.mean_view) / dot(weighted, direction);
    let apart = sub(direction.map(|d| nearest * d), solid.mean_view);
    let power = 0.5 * dot(apart, transform(solid.inverse, apart));
    // As `raw_alpha`: e⁻⁵⁰ is lost in the rounding of any sum here.
    (nearest > 0.0 && power <= 50.0).then(|| Layer {
        alpha: (solid.screen.opacity * (-power).exp()).min(Thresholds::NONE.alpha_max),
        color: solid.screen.color,
        depth: solid.screen.depth,
    })
}

fn solid(splat: &Splat<f64>, screen: ScreenSplat<f64>, view: &Viewpoint) -> Solid {
    let rotation = matrix(view.camera.rotation);
    let mean_view = transform(rotation, sub(splat.mean, vector(view.camera.position)));
    let world = covariance(splat.quaternion, splat.log_scale);
    let mut spread = product(product(rotation, world), transpose(rotation));
    let [x, y, z] = mean_view;
    let [fx, fy] = view.camera.focal.to_array();
    // J has orthogonal null vector m: J⁺ maps into the plane across it.
    let rows = [[fx / z, 0.0, -fx * x / (z * z)], [0.0, fy / z, -fy * y / (z * z)]];
    let gram = [dot(rows[0], rows[0]), dot(rows[0], rows[1]), dot(rows[1], rows[1])];
    let det = gram[0] * gram[2] - gram[1] * gram[1];
    let columns: [[f64; 3]; 2] = [
        std::array::from_fn(|k| (gram[2] * rows[0][k] - gram[1] * rows[1][k]) / det),
        std::array::from_fn(|k| (gram[0] * rows[1][k] - gram[1] * rows[0][k]) / det),
    ];
    for (i, row) in spread.iter_mut().enumerate() {
        for (j, entry) in row.iter_mut().enumerate() {
            *entry += view.dilation * (columns[0][i] * columns[0][j] + columns[1][i] * columns[1][j]);
        }
    }
    Solid {
        screen,
        mean_view,
        inverse: inverse(spread),
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Inverse of a symmetric matrix: its rows' cross products over its determinant.
fn inverse([a, b, c]: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let adjugate = [cross(b, c), cross(c, a), cross(a, b)];
    let det = dot(a, adjugate[0]);
    adjugate.map(|row| row.map(|entry| entry / det))
}
