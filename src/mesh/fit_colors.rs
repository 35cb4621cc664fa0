//! Colours of a mesh fitted to pictures, by least squares.

use super::depth_map::DepthMap;
use super::depth_maps::DepthMaps;
use super::draw::{GREY, VisiblePoint, visible_points};
use crate::Result;
use crate::scene::Mesh;
use crate::stats::conjugate_gradients::{self, SymmetricSystem};
use glam::Vec3;
use rayon::prelude::*;

/// Weight of a vertex's colour before the fit, in pixels: vertices that no pixel shows keep it, and noise of vertices
/// that few pixels show stays small. With 0.1, the fox has SSIM 0.802 in place of 0.806 (`2026-11-27-mesh-colors.csv`).
const PRIOR: f32 = 1.0;
/// Most steps of conjugate gradients, and decrease of the squared residual.
const STEPS: usize = 30;
const DECREASE: f64 = 1e-6;

/// Options of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorFitOptions {
    /// Nearest depth that is drawn, world units.
    pub near: f64,
    /// Most distance between mesh and surface of a pixel that counts, along the normal, world units.
    pub distance_max: f64,
}

/// Fits the colours of vertices to the pictures of views, so that the sum over pixels of the squared difference
/// between pictures and drawings of the mesh is least. A pixel counts by its coverage, where the mesh is near the
/// surface of its map. A mesh without colours starts grey. `progress` is told each view, and may end the fit with an
/// error; the mesh is then as before.
///
/// # Errors
/// Those of drawing and of `progress`.
pub fn fit_colors(
    mesh: &mut Mesh,
    options: ColorFitOptions,
    views: &mut DepthMaps<'_>,
    mut progress: impl FnMut(usize) -> Result<()>,
) -> Result<()> {
    let mut sums = ColorEquations::new(mesh);
    let mut first = mesh.colors.clone();
    first.resize(mesh.positions.len(), GREY);
    for view in 0..views.count() {
        progress(view)?;
        views.with(view, |map| {
            let points = visible_points(mesh, &map.camera, options.near);
            for (pixel, point) in points.iter().enumerate() {
                if let Some(point) = point {
                    sums.add(point, weight(map, pixel, point, options), map.rgb(pixel));
                }
            }
            Ok(())
        })?;
    }
    mesh.colors = sums.solve(&first);
    Ok(())
}

/// Weight of a pixel.
fn weight(map: &DepthMap, pixel: usize, point: &VisiblePoint, options: ColorFitOptions) -> f32 {
    let apart = (point.depth - f64::from(map.depth[pixel])).abs() * f64::from(map.slope[pixel]);
    // Written so that NaN fails.
    match apart <= options.distance_max {
        true => f32::from(map.color[pixel][3]) / 255.0,
        false => 0.0,
    }
}

/// Matrix and right-hand side of the least squares.
struct ColorEquations<'a> {
    triangles: &'a [[u32; 3]],
    /// Entries of the vertices.
    diagonal: Vec<f32>,
    /// Entries of each triangle's edges, from corner to corner.
    beside: Vec<[f32; 3]>,
    right: Vec<Vec3>,
}

impl ColorEquations<'_> {
    fn new(mesh: &Mesh) -> ColorEquations<'_> {
        ColorEquations {
            triangles: &mesh.triangles,
            diagonal: vec![0.0; mesh.positions.len()],
            beside: vec![[0.0; 3]; mesh.triangles.len()],
            right: vec![Vec3::ZERO; mesh.positions.len()],
        }
    }

    fn add(&mut self, point: &VisiblePoint, weight: f32, color: Vec3) {
        let shares = point.weights.as_vec3().to_array();
        for (corner, &vertex) in self.triangles[point.triangle].iter().enumerate() {
            let next = shares[(corner + 1) % 3];
            self.diagonal[vertex as usize] += weight * shares[corner] * shares[corner];
            self.right[vertex as usize] += weight * shares[corner] * color;
            self.beside[point.triangle][corner] += weight * shares[corner] * next;
        }
    }

    /// Colours by conjugate gradients from `first`, channel by channel.
    fn solve(mut self, first: &[[f32; 3]]) -> Vec<[f32; 3]> {
        for ((diagonal, right), &color) in self.diagonal.iter_mut().zip(&mut self.right).zip(first) {
            *diagonal += PRIOR;
            *right += PRIOR * Vec3::from(color);
        }
        let channel = |channel: usize| {
            let mut solution: Vec<f64> = first.iter().map(|color| f64::from(color[channel])).collect();
            let pairs = self.right.iter().zip(self.product(&solution));
            let residual = pairs.map(|(right, of)| f64::from(right[channel]) - of).collect();
            conjugate_gradients::improve(&self, &mut solution, residual, |energy| DECREASE * energy, STEPS);
            solution
        };
        let channels: Vec<Vec<f64>> = (0..3).into_par_iter().map(channel).collect();
        let color = |vertex: usize| [0, 1, 2].map(|channel: usize| channels[channel][vertex].clamp(0.0, 1.0) as f32);
        (0..first.len()).map(color).collect()
    }
}

impl SymmetricSystem for ColorEquations<'_> {
    fn product(&self, vector: &[f64]) -> Vec<f64> {
        let pairs = self.diagonal.iter().zip(vector);
        let mut product: Vec<f64> = pairs.map(|(entry, x)| f64::from(*entry) * x).collect();
        for (corners, entries) in self.triangles.iter().zip(&self.beside) {
            if *entries == [0.0; 3] {
                continue;
            }
            let corners = corners.map(|vertex| vertex as usize);
            let entries = entries.map(f64::from);
            let values = corners.map(|vertex| vector[vertex]);
            for i in 0..3 {
                let (next, last) = ((i + 1) % 3, (i + 2) % 3);
                product[corners[i]] += entries[i] * values[next] + entries[last] * values[last];
            }
        }
        product
    }

    fn precondition(&self, vector: &[f64]) -> Vec<f64> {
        let pairs = self.diagonal.iter().zip(vector);
        pairs.map(|(entry, x)| x / f64::from(*entry)).collect()
    }
}
