//! Distances between a mesh and the true one.

use super::tree::TriangleTree;
use crate::scene::{Camera, Mesh};
use crate::stats::{SplitMix64, quantile};
use crate::{Error, Result};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

/// Options of a comparison.
#[derive(Clone, Debug)]
pub struct ComparisonOptions {
    /// Points on each mesh, by area.
    pub samples: usize,
    /// Seed of the points.
    pub seed: u64,
    /// Distance at which a point counts as met, world units; `None`: a pixel's footprint with cameras, else a 200th of
    /// the truth's diagonal.
    pub threshold: Option<f64>,
    /// Cameras. Points of the truth count where two see them, points of the mesh where one does, near the truth;
    /// without cameras all count.
    pub cameras: Vec<Camera>,
}

impl Default for ComparisonOptions {
    fn default() -> ComparisonOptions {
        ComparisonOptions {
            samples: 200_000,
            seed: 0,
            threshold: None,
            cameras: Vec::new(),
        }
    }
}

/// Share of the diagonal that is the threshold without cameras.
const THRESHOLD_SHARE: f64 = 0.005;
/// Multiples of the threshold with scores.
const MULTIPLES: [f64; 4] = [0.5, 1.0, 1.5, 3.0];
/// Footprints around the truth within which points of the mesh count, with cameras.
const MARGIN_FOOTPRINTS: f64 = 5.0;
/// Share of a ray's length by which its end may be behind the surface it lies on.
const CLEARANCE: f64 = 1e-3;

/// Distances in world units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DistanceSummary {
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
    /// Points.
    pub points: usize,
}

/// Shares of points within a distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ThresholdScore {
    /// The distance, world units.
    pub threshold: f64,
    /// Share of the mesh's points.
    pub precision: f64,
    /// Share of the truth's points.
    pub recall: f64,
    /// Harmonic mean of both.
    pub f1: f64,
}

/// Angles between normals of the mesh and of the nearest triangles of the truth, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NormalSummary {
    /// Mean, for sides that look alike (0 to 90).
    pub mean: f64,
    /// Median, likewise.
    pub median: f64,
    /// Mean of angles between outward sides (0 to 180).
    pub mean_outward: f64,
}

/// A mesh beside the true one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshComparison {
    /// From the mesh to the truth.
    pub accuracy: DistanceSummary,
    /// From the truth to the mesh; the largest is the largest hole.
    pub completeness: DistanceSummary,
    /// Mean of both means, as for DTU.
    pub chamfer: f64,
    /// At half, once, one and a half and three times the threshold.
    pub scores: Vec<ThresholdScore>,
    /// Normals.
    pub normal_deg: NormalSummary,
    /// Diagonal of the truth's box, world units.
    pub diagonal: f64,
    /// Median footprint of a pixel on the truth, world units, with cameras.
    pub footprint: Option<f64>,
}

/// A point on a mesh.
#[derive(Clone, Copy, Debug)]
struct SurfacePoint {
    position: DVec3,
    /// Unit normal of its triangle.
    normal: DVec3,
}

/// Compares a mesh with the true one; `shift` is added to the mesh's positions. Distances are exact, from points to
/// triangles.
///
/// # Errors
/// [`Error::Config`] if no point counts.
pub fn compare(mesh: &Mesh, shift: DVec3, truth: &Mesh, options: &ComparisonOptions) -> Result<MeshComparison> {
    let [found, truth] = [(mesh, shift), (truth, DVec3::ZERO)].map(|(mesh, shift)| TriangleTree::new(mesh, shift));
    let [low, high] = truth.bounds();
    let diagonal = (high - low).length();
    let mut wanted = sample(&truth, options.samples, options.seed);
    let mut made = sample(&found, options.samples, options.seed.wrapping_add(1));
    let mut footprint = None;
    if !options.cameras.is_empty() {
        let mut footprints: Vec<f64> = Vec::new();
        let seen: Vec<Vec<f64>> = wanted
            .par_iter()
            .map(|p| footprints_at(p, &truth, &options.cameras))
            .collect();
        let mut each = seen.iter();
        wanted.retain(|_| each.next().is_some_and(|seen| seen.len() >= 2));
        footprints.extend(seen.iter().filter(|seen| seen.len() >= 2).flatten());
        let Some(pixel) = quantile(&mut footprints, 0.5) else {
            return Err(Error::Config("no two cameras see a point of the true mesh".into()));
        };
        footprint = Some(pixel);
        let margin = DVec3::splat(MARGIN_FOOTPRINTS * pixel);
        let near = |p: &SurfacePoint| p.position.clamp(low - margin, high + margin) == p.position;
        let counts = |p: &SurfacePoint| near(p) && !footprints_at(p, &found, &options.cameras).is_empty();
        made = made.into_par_iter().filter(counts).collect();
    }
    if made.is_empty() || wanted.is_empty() {
        return Err(Error::Config(
            "no point of the mesh is near the true one and in sight of a camera".into(),
        ));
    }
    let to_truth: Vec<(f64, usize)> = made.par_iter().map(|p| truth.nearest(p.position)).collect();
    let mut accuracy: Vec<f64> = to_truth.iter().map(|(distance, _)| *distance).collect();
    let mut completeness: Vec<f64> = wanted.par_iter().map(|p| found.nearest(p.position).0).collect();
    let threshold = options.threshold.or(footprint).unwrap_or(THRESHOLD_SHARE * diagonal);
    let score = |multiple: f64| score(&accuracy, &completeness, multiple * threshold);
    let scores = MULTIPLES.map(score).to_vec();
    let cosines = made.iter().zip(&to_truth);
    let cosines = cosines.map(|(p, (_, index))| p.normal.dot(normal_of(&truth.triangles()[*index])));
    let normal_deg = normals(cosines.collect());
    let (accuracy, completeness) = (summary(&mut accuracy), summary(&mut completeness));
    Ok(MeshComparison {
        chamfer: 0.5 * (accuracy.mean + completeness.mean),
        accuracy,
        completeness,
        scores,
        normal_deg,
        diagonal,
        footprint,
    })
}

/// Points by area: evenly spaced over the triangles one after the other, at random within each.
fn sample(tree: &TriangleTree, count: usize, seed: u64) -> Vec<SurfacePoint> {
    let area = |t: &[DVec3; 3]| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
    let total: f64 = tree.triangles().iter().map(area).sum();
    let mut random = SplitMix64(seed);
    let mut points = Vec::with_capacity(count);
    let mut before = 0.0;
    for triangle in tree.triangles() {
        before += area(triangle);
        // A last one may be lost to the rounding of the sum.
        while points.len() < count && (points.len() as f64 + 0.5) / count as f64 * total <= before {
            let (mut u, mut v) = (random.unit(), random.unit());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let [a, b, c] = *triangle;
            points.push(SurfacePoint {
                position: a + (b - a) * u + (c - a) * v,
                normal: normal_of(triangle),
            });
        }
    }
    points
}

fn normal_of(&[a, b, c]: &[DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a).normalize_or_zero()
}

/// Footprint of a pixel of each camera that sees a point past a mesh, world units.
fn footprints_at(point: &SurfacePoint, mesh: &TriangleTree, cameras: &[Camera]) -> Vec<f64> {
    let footprint = |camera: &Camera| {
        let before = camera.position.lerp(point.position, 1.0 - CLEARANCE);
        let is_seen = camera.sees(point.position) && mesh.is_free(camera.position, before);
        is_seen.then(|| camera.view_from_world(point.position).z / camera.focal.max_element())
    };
    cameras.iter().filter_map(footprint).collect()
}

fn score(accuracy: &[f64], completeness: &[f64], threshold: f64) -> ThresholdScore {
    let share = |distances: &[f64]| {
        distances.iter().filter(|d| **d <= threshold).count() as f64 / distances.len().max(1) as f64
    };
    let (precision, recall) = (share(accuracy), share(completeness));
    let sum = precision + recall;
    ThresholdScore {
        threshold,
        precision,
        recall,
        f1: if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 },
    }
}

fn normals(cosines: Vec<f64>) -> NormalSummary {
    let angle = |cosine: f64| cosine.clamp(-1.0, 1.0).acos().to_degrees();
    let mut either: Vec<f64> = cosines.iter().map(|c| angle(c.abs())).collect();
    let mean = |angles: &[f64]| angles.iter().sum::<f64>() / angles.len().max(1) as f64;
    NormalSummary {
        mean: mean(&either),
        median: quantile(&mut either, 0.5).unwrap_or(0.0),
        mean_outward: mean(&cosines.iter().map(|c| angle(*c)).collect::<Vec<_>>()),
    }
}

fn summary(distances: &mut [f64]) -> DistanceSummary {
    DistanceSummary {
        mean: distances.iter().sum::<f64>() / distances.len().max(1) as f64,
        median: quantile(distances, 0.5).unwrap_or(0.0),
        p95: quantile(distances, 0.95).unwrap_or(0.0),
        max: quantile(distances, 1.0).unwrap_or(0.0),
        points: distances.len(),
    }
}
