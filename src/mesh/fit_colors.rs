//! Colours of a mesh fitted to pictures, by least squares.

use super::depth_map::DepthMap;
use super::depth_maps::DepthMaps;
use super::draw::{GREY, VisiblePoint, visible_points};
use crate::Result;
use crate::scene::Mesh;
use crate::stats::conjugate_gradients::{self, SymmetricSystem};
use glam::Vec3;
use std::collections::HashMap;

/// Weight of a vertex's colour before the fit, in pixels: vertices that no pixel shows keep it, and noise of vertices
/// that few pixels show stays small. With 0.1, the fox has SSIM 0.802 in place of 0.806 (`2026-11-27-mesh-colors.csv`).
const PRIOR: f32 = 1.0;
/// Steps of conjugate gradients.
const STEPS: usize = 30;

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
                    sums.add(mesh, point, weight(map, pixel, point, options), map.rgb(pixel));
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

/// Matrix and right-hand side of the least squares. The matrix has an entry for each vertex and each edge.
struct ColorEquations {
    /// Edges of each triangle's corners 0 1, 1 2, 2 0.
    edges: Vec<[u32; 3]>,
    /// Vertices of each edge.
    ends: Vec<[u32; 2]>,
    diagonal: Vec<f32>,
    /// Entries of the edges.
    beside: Vec<f32>,
    right: Vec<Vec3>,
}

impl ColorEquations {
    fn new(mesh: &Mesh) -> ColorEquations {
        let mut known: HashMap<[u32; 2], u32> = HashMap::new();
        let mut ends = Vec::new();
        let mut edge = |a: u32, b: u32| {
            let key = [a.min(b), a.max(b)];
            *known.entry(key).or_insert_with(|| {
                ends.push(key);
                ends.len() as u32 - 1
            })
        };
        let triangles = mesh.triangles.iter();
        let edges = triangles
            .map(|&[a, b, c]| [edge(a, b), edge(b, c), edge(c, a)])
            .collect();
        ColorEquations {
            edges,
            diagonal: vec![0.0; mesh.positions.len()],
            beside: vec![0.0; ends.len()],
            right: vec![Vec3::ZERO; mesh.positions.len()],
            ends,
        }
    }

    fn add(&mut self, mesh: &Mesh, point: &VisiblePoint, weight: f32, color: Vec3) {
        let shares = point.weights.as_vec3().to_array();
        for (corner, &vertex) in mesh.triangles[point.triangle].iter().enumerate() {
            let next = shares[(corner + 1) % 3];
            self.diagonal[vertex as usize] += weight * shares[corner] * shares[corner];
            self.right[vertex as usize] += weight * shares[corner] * color;
            self.beside[self.edges[point.triangle][corner] as usize] += weight * shares[corner] * next;
        }
    }

    /// Colours by conjugate gradients from `first`, channel by channel.
    fn solve(mut self, first: &[[f32; 3]]) -> Vec<[f32; 3]> {
        for ((diagonal, right), &color) in self.diagonal.iter_mut().zip(&mut self.right).zip(first) {
            *diagonal += PRIOR;
            *right += PRIOR * Vec3::from(color);
        }
        let mut colors = first.to_vec();
        for channel in 0..3 {
            let mut solution: Vec<f64> = first.iter().map(|color| f64::from(color[channel])).collect();
            let pairs = self.right.iter().zip(self.product(&solution));
            let residual = pairs.map(|(right, of)| f64::from(right[channel]) - of).collect();
            conjugate_gradients::improve(&self, &mut solution, residual, |_| 0.0, STEPS);
            for (color, value) in colors.iter_mut().zip(solution) {
                color[channel] = value.clamp(0.0, 1.0) as f32;
            }
        }
        colors
    }
}

impl SymmetricSystem for ColorEquations {
    fn product(&self, vector: &[f64]) -> Vec<f64> {
        let pairs = self.diagonal.iter().zip(vector);
        let mut product: Vec<f64> = pairs.map(|(entry, x)| f64::from(*entry) * x).collect();
        for (&[a, b], &entry) in self.ends.iter().zip(&self.beside) {
            product[a as usize] += f64::from(entry) * vector[b as usize];
            product[b as usize] += f64::from(entry) * vector[a as usize];
        }
        product
    }

    fn precondition(&self, vector: &[f64]) -> Vec<f64> {
        let pairs = self.diagonal.iter().zip(vector);
        pairs.map(|(entry, x)| x / f64::from(*entry)).collect()
    }
}
