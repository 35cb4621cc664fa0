//! Triangles in a tree of boxes: the nearest point, and whether a segment is free.

use crate::scene::Mesh;
use glam::DVec3;

/// Most triangles of a leaf.
const LEAF_TRIANGLES: usize = 4;

/// A mesh in a binary tree of boxes.
#[derive(Clone, Debug)]
pub(super) struct TriangleTree {
    triangles: Vec<[DVec3; 3]>,
    nodes: Vec<TreeNode>,
}

#[derive(Clone, Copy, Debug)]
struct TreeNode {
    low: DVec3,
    high: DVec3,
    /// First and last-but-one triangle of a leaf, or the second child and 0; the first child follows its parent.
    place: usize,
    count: usize,
}

impl TriangleTree {
    /// Tree of a mesh, moved by `shift`.
    pub(super) fn new(mesh: &Mesh, shift: DVec3) -> TriangleTree {
        let corner = |position: [f32; 3]| DVec3::from(position.map(f64::from)) + shift;
        let mut triangles: Vec<[DVec3; 3]> = (0..mesh.triangles.len()).map(|i| mesh.corners(i).map(corner)).collect();
        let mut nodes = Vec::new();
        let count = triangles.len();
        if count > 0 {
            split(&mut triangles, 0..count, &mut nodes);
        }
        TriangleTree { triangles, nodes }
    }

    /// The triangles, in the order of the tree.
    pub(super) fn triangles(&self) -> &[[DVec3; 3]] {
        &self.triangles
    }

    /// Box around all triangles; empty without any.
    pub(super) fn bounds(&self) -> [DVec3; 2] {
        self.nodes
            .first()
            .map_or([DVec3::ZERO; 2], |root| [root.low, root.high])
    }

    /// Distance from a point to the nearest triangle, and its index; infinite without triangles.
    pub(super) fn nearest(&self, point: DVec3) -> (f64, usize) {
        let (mut squared, mut found) = (f64::INFINITY, 0);
        let mut pending = Vec::with_capacity(64);
        pending.extend(self.nodes.first().map(|root| (root.squared_distance(point), 0)));
        while let Some((least, index)) = pending.pop() {
            if least >= squared {
                continue;
            }
            let node = &self.nodes[index];
            if node.count > 0 {
                for i in node.place..node.place + node.count {
                    let distance = nearest_point(&self.triangles[i], point).distance_squared(point);
                    if distance < squared {
                        (squared, found) = (distance, i);
                    }
                }
                continue;
            }
            let mut children = [index + 1, node.place].map(|i| (self.nodes[i].squared_distance(point), i));
            // The nearer one is looked at first.
            children.sort_by(|a, b| b.0.total_cmp(&a.0));
            pending.extend(children);
        }
        (squared.sqrt(), found)
    }

    /// True if no triangle crosses the segment between two points.
    pub(super) fn is_free(&self, from: DVec3, to: DVec3) -> bool {
        let direction = to - from;
        let inverse = direction.recip();
        let mut pending = Vec::with_capacity(64);
        pending.extend((!self.nodes.is_empty()).then_some(0));
        while let Some(index) = pending.pop() {
            let node = &self.nodes[index];
            if !node.meets(from, inverse) {
                continue;
            }
            if node.count == 0 {
                pending.extend([node.place, index + 1]);
            } else if self.triangles[node.place..][..node.count]
                .iter()
                .any(|t| crosses(t, from, direction))
            {
                return false;
            }
        }
        true
    }
}

/// Appends the tree over `triangles[range]`, sorting them into the order of its leaves.
fn split(triangles: &mut [[DVec3; 3]], range: std::ops::Range<usize>, nodes: &mut Vec<TreeNode>) {
    let part = &mut triangles[range.clone()];
    let corners = || part.iter().flatten().copied();
    let low = corners().fold(DVec3::INFINITY, DVec3::min);
    let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
    let node = nodes.len();
    let count = range.len();
    nodes.push(TreeNode {
        low,
        high,
        place: range.start,
        count,
    });
    if count <= LEAF_TRIANGLES {
        return;
    }
    let axis = (high - low).max_position();
    let key = |t: &[DVec3; 3]| t[0][axis] + t[1][axis] + t[2][axis];
    part.select_nth_unstable_by(count / 2, |a, b| key(a).total_cmp(&key(b)));
    let middle = range.start + count / 2;
    split(triangles, range.start..middle, nodes);
    (nodes[node].place, nodes[node].count) = (nodes.len(), 0);
    split(triangles, middle..range.end, nodes);
}

impl TreeNode {
    fn squared_distance(&self, point: DVec3) -> f64 {
        point.clamp(self.low, self.high).distance_squared(point)
    }

    /// True if the segment from `origin`, of the length 1, passes the box.
    fn meets(&self, origin: DVec3, inverse: DVec3) -> bool {
        let (t0, t1) = ((self.low - origin) * inverse, (self.high - origin) * inverse);
        // f64::min and max ignore a NaN operand (0 · ∞), which keeps the box.
        let enter = (0..3).map(|i| t0[i].min(t1[i])).fold(0.0, f64::max);
        let leave = (0..3).map(|i| t0[i].max(t1[i])).fold(1.0, f64::min);
        enter <= leave
    }
}

/// The point of a triangle nearest to another: that of its plane, of a side or of a corner.
fn nearest_point(&[a, b, c]: &[DVec3; 3], point: DVec3) -> DVec3 {
    let normal = (b - a).cross(c - a);
    let inner = [(a, b), (b, c), (c, a)].map(|(from, to)| normal.cross(to - from).dot(point - from) >= 0.0);
    if inner == [true; 3] && normal != DVec3::ZERO {
        return point - normal * (normal.dot(point - a) / normal.length_squared());
    }
    let on_side = |(from, to): (DVec3, DVec3)| {
        let side = to - from;
        let share = (point - from).dot(side) / side.length_squared();
        // A side without length is its corner.
        from + side * if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    };
    let sides = [(a, b), (b, c), (c, a)].map(on_side);
    let nearer = |x: DVec3, y: DVec3| {
        if y.distance_squared(point) < x.distance_squared(point) {
            y
        } else {
            x
        }
    };
    nearer(nearer(sides[0], sides[1]), sides[2])
}

/// True if a segment from `origin` crosses a triangle (Möller and Trumbore 1997, both sides).
fn crosses(&[a, b, c]: &[DVec3; 3], origin: DVec3, direction: DVec3) -> bool {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let determinant = ab.dot(p);
    let from_a = origin - a;
    let u = from_a.dot(p) / determinant;
    let q = from_a.cross(ab);
    let v = direction.dot(q) / determinant;
    let t = ac.dot(q) / determinant;
    // Written so that a triangle seen edge-on (NaN) is missed.
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SplitMix64;

    fn triangles(count: usize) -> Mesh {
        let mut random = SplitMix64(3);
        let mut number = || random.unit() as f32;
        let positions = (0..3 * count).map(|_| [number(), number(), number()]).collect();
        Mesh {
            positions,
            triangles: (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            ..Mesh::default()
        }
    }

    /// The nearest of many points of a triangle.
    fn sampled(&[a, b, c]: &[DVec3; 3], point: DVec3) -> f64 {
        let shares = (0..=200).flat_map(|i| (0..=200 - i).map(move |j| (f64::from(i) / 200.0, f64::from(j) / 200.0)));
        shares
            .map(|(u, v)| (a + (b - a) * u + (c - a) * v).distance(point))
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn the_nearest_point_is_found() {
        let tree = TriangleTree::new(&triangles(60), DVec3::ZERO);
        let mut random = SplitMix64(4);
        for _ in 0..40 {
            let [x, y, z] = [(); 3].map(|()| 2.0 * random.unit() - 0.5);
            let point = DVec3::new(x, y, z);
            let (distance, index) = tree.nearest(point);
            let least = tree
                .triangles
                .iter()
                .map(|t| sampled(t, point))
                .fold(f64::INFINITY, f64::min);
            assert!(distance <= least && least - distance < 0.01, "{distance}, not {least}");
            assert!((nearest_point(&tree.triangles[index], point).distance(point) - distance).abs() < 1e-12);
        }
        assert_eq!(
            TriangleTree::new(&Mesh::default(), DVec3::ZERO).nearest(DVec3::ZERO).0,
            f64::INFINITY
        );
    }

    #[test]
    fn degenerate_triangles_are_segments_and_points() {
        let [a, b] = [DVec3::ZERO, DVec3::X];
        assert_eq!(
            nearest_point(&[a, b, a], DVec3::new(0.5, 1.0, 0.0)),
            DVec3::new(0.5, 0.0, 0.0)
        );
        assert_eq!(nearest_point(&[a, a, a], DVec3::new(0.5, 1.0, 0.0)), DVec3::ZERO);
    }

    #[test]
    fn segments_are_blocked_by_what_they_cross() {
        let tree = TriangleTree::new(&triangles(1), DVec3::ZERO);
        let [a, b, c] = tree.triangles[0];
        let (middle, normal) = ((a + b + c) / 3.0, (b - a).cross(c - a).normalize());
        assert!(!tree.is_free(middle - normal, middle + normal));
        assert!(tree.is_free(middle + 0.1 * normal, middle + normal));
        assert!(tree.is_free(middle - normal + 3.0 * (a - b), middle + normal + 3.0 * (a - b)));
    }
}
