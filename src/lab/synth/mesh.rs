//! Triangle mesh in a tree of boxes, for ray casting.

use super::ray::{Hit, Ray};
use crate::scene::Mesh;
use glam::DVec3;

/// Most triangles of a leaf; a leaf costs about as much as two boxes.
const LEAF_TRIANGLES: usize = 4;

/// A triangle mesh in a binary tree of boxes.
#[derive(Clone, Debug)]
pub struct MeshTree {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
    pub(super) bounding_radius: f64,
}

#[derive(Clone, Copy, Debug)]
struct Triangle {
    corners: [DVec3; 3],
    /// Unit normals at the corners.
    normals: [DVec3; 3],
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    content: Content,
}

#[derive(Clone, Copy, Debug)]
enum Content {
    /// Index of the second child; the first follows its parent.
    Inner(usize),
    /// Triangles `.0..(.0 + .1)`.
    Leaf(usize, usize),
}

impl MeshTree {
    /// Tree of a mesh with counter-clockwise triangles. It is shaded with the mean normals of its vertices, but its
    /// depth and normals are those of the flat triangles.
    pub fn new(mesh: &Mesh) -> MeshTree {
        let position = |vertex: u32| DVec3::from(mesh.positions[vertex as usize].map(f64::from));
        let mut normals = vec![DVec3::ZERO; mesh.positions.len()];
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(position);
            for &vertex in triangle {
                // Not normalised: weighted by area.
                normals[vertex as usize] += (b - a).cross(c - a);
            }
        }
        let triangle = |vertices: &[u32; 3]| Triangle {
            corners: vertices.map(position),
            normals: vertices.map(|vertex| normals[vertex as usize].normalize_or_zero()),
        };
        let mut triangles: Vec<Triangle> = mesh.triangles.iter().map(triangle).collect();
        let mut nodes = Vec::new();
        let count = triangles.len();
        if count > 0 {
            split(&mut triangles, 0..count, &mut nodes);
        }
        let radius = |t: &Triangle| t.corners.map(|c| c.length()).into_iter().fold(0.0, f64::max);
        let bounding_radius = triangles.iter().map(radius).fold(0.0, f64::max);
        MeshTree {
            triangles,
            nodes,
            bounding_radius,
        }
    }

    /// Corners of all triangles, and their indices.
    pub(super) fn soup(&self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let corners = self.triangles.iter().flat_map(|t| t.corners).collect();
        let triangle = |i: u32| [3 * i, 3 * i + 1, 3 * i + 2];
        (corners, (0..self.triangles.len() as u32).map(triangle).collect())
    }

    /// The nearest triangle on the ray with a distance in `t_min..t_max`.
    pub(super) fn hit(&self, ray: &Ray, t_min: f64, t_max: f64) -> Option<Hit> {
        let inverse = ray.direction.recip();
        let mut nearest: Option<Hit> = None;
        // The tree's depth is logarithmic, as `split` halves.
        let mut pending = Vec::with_capacity(64);
        pending.extend((!self.nodes.is_empty()).then_some(0));
        while let Some(index) = pending.pop() {
            let limit = nearest.map_or(t_max, |hit| hit.t);
            let node = &self.nodes[index];
            if !node.meets(ray.origin, inverse, t_min, limit) {
                continue;
            }
            match node.content {
                Content::Inner(second) => pending.extend([second, index + 1]),
                Content::Leaf(first, count) => {
                    for triangle in &self.triangles[first..first + count] {
                        let limit = nearest.map_or(t_max, |hit| hit.t);
                        nearest = triangle.hit(ray, t_min, limit).or(nearest);
                    }
                }
            }
        }
        nearest
    }
}

/// Appends the tree over `triangles[range]`, sorting them into the order of its leaves.
fn split(triangles: &mut [Triangle], range: std::ops::Range<usize>, nodes: &mut Vec<Node>) {
    let part = &mut triangles[range.clone()];
    let corners = || part.iter().flat_map(|t| t.corners);
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    let content = Content::Leaf(range.start, range.len());
    let node = nodes.len();
    nodes.push(Node { low, high, content });
    if range.len() <= LEAF_TRIANGLES {
        return;
    }
    let axis = (high - low).max_position();
    let key = |t: &Triangle| t.corners[0][axis] + t.corners[1][axis] + t.corners[2][axis];
    let middle = range.len() / 2;
    part.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    let middle = range.start + middle;
    split(triangles, range.start..middle, nodes);
    nodes[node].content = Content::Inner(nodes.len());
    split(triangles, middle..range.end, nodes);
}

impl Node {
    /// True if the ray passes the box between the distances `t_min` and `t_max`.
    fn meets(&self, origin: DVec3, inverse: DVec3, t_min: f64, t_max: f64) -> bool {
        let (t0, t1) = ((self.low - origin) * inverse, (self.high - origin) * inverse);
        // f64::min and max ignore a NaN operand (0 · ∞), which keeps the box.
        let enter = (0..3).map(|i| t0[i].min(t1[i])).fold(t_min, f64::max);
        let leave = (0..3).map(|i| t0[i].max(t1[i])).fold(t_max, f64::min);
        enter <= leave
    }
}

impl Triangle {
    /// Möller and Trumbore 1997, from both sides.
    fn hit(&self, ray: &Ray, t_min: f64, t_max: f64) -> Option<Hit> {
        let [a, b, c] = self.corners;
        let (ab, ac) = (b - a, c - a);
        let p = ray.direction.cross(ac);
        let determinant = ab.dot(p);
        let from_a = ray.origin - a;
        let u = from_a.dot(p) / determinant;
        let q = from_a.cross(ab);
        let v = ray.direction.dot(q) / determinant;
        let t = ac.dot(q) / determinant;
        // Written so that a triangle seen edge-on (NaN) is missed.
        let met = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > t_min && t < t_max;
        met.then(|| {
            let [na, nb, nc] = self.normals;
            let smooth = (1.0 - u - v) * na + u * nb + v * nc;
            let normal = ab.cross(ac).normalize();
            Hit {
                t,
                normal,
                shading_normal: smooth.try_normalize().unwrap_or(normal),
            }
        })
    }
}
