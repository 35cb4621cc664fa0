//! Procedural meshes.

use super::random::KeyedRandom;
use crate::scene::Mesh;
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use std::f64::consts::TAU;

/// A sphere of radius 1 from an icosahedron, subdivided `levels` times: 20 · 4^levels triangles.
pub fn icosphere(levels: u32) -> Mesh {
    let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut positions: Vec<DVec3> = Vec::new();
    for (a, b) in [(-1.0, -g), (1.0, -g), (-1.0, g), (1.0, g)] {
        let corners = [DVec3::new(a, b, 0.0), DVec3::new(0.0, a, b), DVec3::new(b, 0.0, a)];
        positions.extend(corners.map(DVec3::normalize));
    }
    let mut triangles = hull(&positions);
    for _ in 0..levels {
        let mut middle_from_edge = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middle_from_edge.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push((positions[a as usize] + positions[b as usize]).normalize());
                positions.len() as u32 - 1
            })
        };
        let divide = |[a, b, c]: [u32; 3]| {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        };
        triangles = triangles.into_iter().flat_map(divide).collect();
    }
    mesh(&positions, triangles)
}

/// The triangles of an icosahedron: all triples of mutually nearest corners, counter-clockwise.
fn hull(corners: &[DVec3]) -> Vec<[u32; 3]> {
    // Neighbours on the unit icosahedron are 1.05 apart, others at least 1.7.
    let near = |a: usize, b: usize| corners[a].distance(corners[b]) < 1.2;
    let count = corners.len();
    let mut triangles = Vec::new();
    for a in 0..count {
        for b in (a + 1)..count {
            for c in (b + 1)..count {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outward = corners[a].dot(corners[b].cross(corners[c])) > 0.0;
                    let [b, c] = if outward { [b, c] } else { [c, b] };
                    triangles.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    triangles
}

/// A tube of the given radius along a trefoil knot about 3 units wide and 1 high:
/// `2 · steps · sides` triangles.
pub fn knot(tube_radius: f64, steps: u32, sides: u32) -> Mesh {
    let scale = 0.5;
    let mut positions = Vec::new();
    for step in 0..steps {
        let t = TAU * f64::from(step) / f64::from(steps);
        let path = DVec3::new(
            t.sin() + 2.0 * (2.0 * t).sin(),
            t.cos() - 2.0 * (2.0 * t).cos(),
            -(3.0 * t).sin(),
        );
        let along = DVec3::new(
            t.cos() + 4.0 * (2.0 * t).cos(),
            -t.sin() + 4.0 * (2.0 * t).sin(),
            -3.0 * (3.0 * t).cos(),
        );
        // The knot is never vertical (its horizontal speed is at least 3), so z spans the frame.
        let across = along.cross(DVec3::Z).normalize();
        let up = across.cross(along).normalize();
        for side in 0..sides {
            let angle = TAU * f64::from(side) / f64::from(sides);
            let DVec2 { x, y } = DVec2::from_angle(angle) * tube_radius;
            positions.push(scale * path + x * across + y * up);
        }
    }
    let vertex = |step: u32, side: u32| (step % steps) * sides + side % sides;
    let quad = |step: u32, side: u32| {
        let (a, b) = (vertex(step, side), vertex(step, side + 1));
        let (c, d) = (vertex(step + 1, side), vertex(step + 1, side + 1));
        [[a, c, b], [b, c, d]]
    };
    let triangles = (0..steps).flat_map(|step| (0..sides).flat_map(move |side| quad(step, side)));
    mesh(&positions, triangles.collect())
}

/// `count` rhombic leaves of this length in all directions, in a ball of radius 1: two triangles each.
pub fn leaves(count: usize, length: f64, seed: u64) -> Mesh {
    let random = &mut KeyedRandom::new(seed, 1);
    let mut positions = Vec::with_capacity(4 * count);
    for _ in 0..count {
        let middle = random.direction() * random.uniform().cbrt();
        let along = random.direction();
        let across = along.any_orthonormal_vector();
        let [along, across] = [0.5 * length * along, 0.3 * length * across];
        positions.extend([-along, across, along, -across].map(|corner| middle + corner));
    }
    let quad = |leaf: u32| [[0, 1, 2], [2, 3, 0]].map(|corners| corners.map(|corner| 4 * leaf + corner));
    mesh(&positions, (0..count as u32).flat_map(quad).collect())
}

/// Open tubes of these radii in turns along the edges of an icosphere of `levels`: `2 · sides` triangles an edge.
pub fn wires<const N: usize>(levels: u32, radii: [f64; N], sides: u32) -> Mesh {
    let ball = icosphere(levels);
    let corner = |vertex: u32| DVec3::from(ball.positions[vertex as usize].map(f64::from));
    let edges = ball.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    // Both triangles of an edge have it, once in each direction.
    for ([a, b], radius) in edges.filter(|[a, b]| a < b).zip(radii.into_iter().cycle()) {
        let [from, to] = [a, b].map(corner);
        let along = (to - from).normalize();
        let across = along.any_orthonormal_vector();
        let first = positions.len() as u32;
        for side in 0..sides {
            let turn = DVec2::from_angle(TAU * f64::from(side) / f64::from(sides)) * radius;
            let offset = turn.x * across + turn.y * along.cross(across);
            positions.extend([from + offset, to + offset]);
            let [here, next] = [side, (side + 1) % sides].map(|side| first + 2 * side);
            triangles.extend([[here, next, here + 1], [here + 1, next, next + 1]]);
        }
    }
    mesh(&positions, triangles)
}

fn mesh(positions: &[DVec3], triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        positions: positions.iter().map(|p| p.as_vec3().to_array()).collect(),
        colors: Vec::new(),
        normals: Vec::new(),
        triangles,
    }
}
