//! Triangles of shapes and scenes: the true mesh.

use super::model::icosphere;
use super::{Object, Scene, Shape};
use crate::scene::Mesh;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Sides of round shapes: chords leave their circle by (π / sides)² / 2 of its radius, 2e-5.
const SIDES: u32 = 512;

/// Subdivisions of a sphere: 20,480 triangles, within 6e-4 of its radius.
const SPHERE_LEVELS: u32 = 5;

impl Scene {
    /// Triangles of all objects in the world, outward; those of planes face +z of their own axes.
    pub fn mesh(&self) -> Mesh {
        let mut mesh = Mesh::default();
        for object in &self.objects {
            let (positions, triangles) = object.triangles();
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(positions.iter().map(|p| p.as_vec3().to_array()));
            mesh.triangles
                .extend(triangles.iter().map(|t| t.map(|vertex| first + vertex)));
        }
        mesh
    }
}

impl Object {
    fn triangles(&self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let (mut positions, triangles) = self.shape.triangles();
        for position in &mut positions {
            *position = self.rotation * *position * self.scale + self.position;
        }
        (positions, triangles)
    }
}

impl Shape {
    fn triangles(&self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        match self {
            Shape::Rectangle(half) => {
                let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
                let corner = |c: [f64; 2]| (DVec2::from(c) * *half).extend(0.0);
                (corners.map(corner).into(), vec![[0, 1, 2], [0, 2, 3]])
            }
            Shape::Disc(radius) => disc(*radius, 0.0, true),
            Shape::Sphere(radius) => {
                let mesh = icosphere(SPHERE_LEVELS);
                let position = |p: &[f32; 3]| DVec3::from(p.map(f64::from)).normalize() * *radius;
                (mesh.positions.iter().map(position).collect(), mesh.triangles)
            }
            Shape::Cuboid(half) => cuboid(*half),
            Shape::Cylinder { radius, half_height } => cylinder(*radius, *half_height),
            Shape::Mesh(tree) => tree.soup(),
        }
    }
}

fn around(radius: f64, height: f64) -> impl Iterator<Item = DVec3> {
    (0..SIDES).map(move |i| (radius * DVec2::from_angle(TAU * f64::from(i) / f64::from(SIDES))).extend(height))
}

/// A fan about the centre, the last vertex.
fn disc(radius: f64, height: f64, is_up: bool) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let positions = around(radius, height).chain([DVec3::new(0.0, 0.0, height)]).collect();
    let triangle = |i: u32| match is_up {
        true => [i, (i + 1) % SIDES, SIDES],
        false => [(i + 1) % SIDES, i, SIDES],
    };
    (positions, (0..SIDES).map(triangle).collect())
}

fn cylinder(radius: f64, half_height: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (mut positions, mut triangles) = disc(radius, half_height, true);
    let (bottom, faces) = disc(radius, -half_height, false);
    positions.extend(bottom);
    triangles.extend(faces.iter().map(|t| t.map(|vertex| vertex + SIDES + 1)));
    for i in 0..SIDES {
        let (above, beside) = (i, (i + 1) % SIDES);
        let (below, across) = (above + SIDES + 1, beside + SIDES + 1);
        triangles.extend([[above, below, beside], [beside, below, across]]);
    }
    (positions, triangles)
}

fn cuboid(half: DVec3) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corner = |c: u32| DVec3::from([c & 1, c >> 1 & 1, c >> 2].map(|bit| 2.0 * f64::from(bit) - 1.0)) * half;
    let faces = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    ((0..8).map(corner).collect(), triangles.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::synth::{Kind, Material, Texture, scene};

    /// Volume within closed triangles.
    fn volume(shape: &Shape) -> f64 {
        let (positions, triangles) = shape.triangles();
        let at = |vertex: u32| positions[vertex as usize];
        triangles
            .iter()
            .map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0)
            .sum()
    }

    #[test]
    fn solids_have_their_volume_and_face_outward() {
        let pi = std::f64::consts::PI;
        let cylinder = Shape::Cylinder {
            radius: 0.5,
            half_height: 2.0,
        };
        for (shape, expected) in [
            (Shape::Sphere(2.0), 32.0 / 3.0 * pi),
            (Shape::Cuboid(DVec3::new(1.0, 2.0, 0.5)), 8.0),
            (cylinder, pi),
        ] {
            let found = volume(&shape);
            assert!(
                (found / expected - 1.0).abs() < 2e-3,
                "{shape:?}: {found}, not {expected}"
            );
        }
        let (positions, triangles) = Shape::Disc(3.0).triangles();
        let [a, b, c] = triangles[7].map(|v| positions[v as usize]);
        assert!((b - a).cross(c - a).z > 0.0);
    }

    #[test]
    fn rays_meet_the_triangles_where_they_meet_the_shapes() {
        // A scene of its own triangles has the same depths.
        let scene = scene(Kind::Solids);
        let dataset = scene.dataset(&crate::lab::synth::SynthOptions {
            views: 2,
            width: 60,
            height: 45,
            samples: 1,
            points: 10,
            ..Default::default()
        });
        let mesh = Shape::Mesh(crate::lab::synth::MeshTree::new(&scene.mesh()));
        let matt = Material::matt(Texture::ripples([0.5; 3], 0.0, 1.0, 0));
        let other = Scene {
            objects: vec![Object::new(mesh, matt)],
            ..Scene::default()
        };
        let camera = &dataset.views[0].camera;
        let (depths, others) = (scene.depth(camera), other.depth(camera));
        let differ = depths
            .iter()
            .zip(&others)
            .filter(|(a, b)| a.is_finite() != b.is_finite() || (*a - *b).abs() > 0.01);
        assert!(differ.count() * 100 < depths.len(), "edges alone may differ");
    }
}
