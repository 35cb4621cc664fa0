//! The built-in scenes, from trivial to intricate. World: z up, about five units across.

use super::material::{Material, Texture};
use super::mesh::MeshTree;
use super::model::{icosphere, knot, leaves, wires};
use super::random::KeyedRandom;
use super::shape::Shape;
use super::{Object, Rig, Scene};
use crate::scene::Mesh;
use glam::{DMat3, DVec2, DVec3};

/// A built-in scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One textured square that fills the pictures, seen from an arc in front of it.
    Plane,
    /// One matt sphere with a ripple texture before black.
    Sphere,
    /// A box, a cylinder and a sphere, matt, on a disc.
    Solids,
    /// The demo: as `Solids`, with highlights and a knot made of triangles.
    Demo,
    /// Two hundred small shapes, striped, rippled and shining, among knots on finely patterned ground.
    Intricate,
    /// Three crowns of small leaves in all directions, in few views far apart.
    Foliage,
    /// A wall of fine courses with windows and sills, in few views from wide apart.
    Facade,
    /// A rippled knot of 38,400 triangles before black.
    Knot,
    /// A ball within a cage of wires, about one to three pixels wide at 384 × 288, before black.
    Cage,
}

impl Kind {
    /// All of them, simplest first, then those for geometry.
    pub const ALL: [Kind; 9] = [
        Kind::Plane,
        Kind::Sphere,
        Kind::Solids,
        Kind::Demo,
        Kind::Intricate,
        Kind::Foliage,
        Kind::Facade,
        Kind::Knot,
        Kind::Cage,
    ];

    /// Whether it is made for measurements of geometry, and left out of surveys of counts.
    pub fn is_for_geometry(self) -> bool {
        matches!(self, Kind::Knot | Kind::Cage)
    }

    /// Name on command lines and in files.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Plane => "plane",
            Kind::Sphere => "sphere",
            Kind::Solids => "solids",
            Kind::Demo => "demo",
            Kind::Intricate => "intricate",
            Kind::Foliage => "foliage",
            Kind::Facade => "facade",
            Kind::Knot => "knot",
            Kind::Cage => "cage",
        }
    }

    /// Number of photographs that show it, in a survey.
    pub fn views(self) -> usize {
        match self {
            Kind::Foliage | Kind::Facade => 18,
            _ => 48,
        }
    }
}

/// Builds a built-in scene.
pub fn scene(kind: Kind) -> Scene {
    match kind {
        Kind::Plane => plane(),
        Kind::Sphere => sphere(),
        Kind::Solids => solids(),
        Kind::Demo => demo(),
        Kind::Intricate => intricate(),
        Kind::Foliage => foliage(),
        Kind::Facade => facade(),
        Kind::Knot => of_mesh(&knot(0.3, 600, 32)),
        Kind::Cage => cage(),
    }
}

/// Scene of a mesh: rippled, its bounding box centred and 2.5 units from corner to corner, before black.
pub fn of_mesh(mesh: &Mesh) -> Scene {
    let corners = || mesh.positions.iter().map(|p| DVec3::from(p.map(f64::from)));
    let low = corners().reduce(DVec3::min).unwrap_or_default();
    let high = corners().reduce(DVec3::max).unwrap_or_default();
    let [middle, diagonal] = [0.5 * (low + high), high - low];
    let centred = corners().map(|p| (p - middle).as_vec3().to_array()).collect();
    let centred = Mesh {
        positions: centred,
        triangles: mesh.triangles.clone(),
        ..Mesh::default()
    };
    let scale = 2.5 / diagonal.length().max(f64::MIN_POSITIVE);
    // Textures are of the mesh's own units.
    let texture = Texture::ripples([0.55, 0.5, 0.42], 0.5, 0.22 / scale, 81);
    let object = Object::new(Shape::Mesh(MeshTree::new(&centred)), Material::matt(texture));
    Scene {
        objects: vec![object.scaled(scale)],
        rig: Rig {
            target: DVec3::ZERO,
            distance: 3.6,
            ..Rig::default()
        },
    }
}

fn plane() -> Scene {
    let texture = Texture::ripples([0.55, 0.5, 0.45], 0.5, 0.3, 11).striped([1.0, 0.4, 0.0], 1.1, [0.12, -0.05, 0.1]);
    // Facing -y, towards the cameras.
    let upright = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    Scene {
        objects: vec![Object::new(Shape::Rectangle(DVec2::splat(8.0)), Material::matt(texture)).turned(upright)],
        rig: Rig {
            target: DVec3::ZERO,
            distance: 4.0,
            azimuth_degrees: (-120.0, -60.0),
            elevation_degrees: (-12.0, 20.0),
        },
    }
}

fn sphere() -> Scene {
    let texture = Texture::ripples([0.5, 0.55, 0.6], 0.6, 0.35, 5);
    Scene {
        objects: vec![Object::new(Shape::Sphere(1.0), Material::matt(texture))],
        rig: Rig {
            target: DVec3::ZERO,
            distance: 3.2,
            ..Rig::default()
        },
    }
}

/// A round stage with soft rings.
fn stage() -> Object {
    let texture = Texture::ripples([0.52, 0.47, 0.42], 0.3, 0.5, 23)
        .striped([1.0, 0.0, 0.0], 1.3, [0.07, 0.05, 0.02])
        .striped([0.0, 1.0, 0.0], 1.3, [0.02, 0.05, 0.08]);
    Object::new(Shape::Disc(2.6), Material::matt(texture))
}

fn solids() -> Scene {
    let ball = Texture::ripples([0.7, 0.35, 0.3], 0.4, 0.3, 2);
    let block = Texture::ripples([0.35, 0.5, 0.7], 0.3, 0.3, 3).striped([0.0, 0.0, 1.0], 0.45, [0.15, 0.15, 0.1]);
    let drum = Texture::ripples([0.4, 0.6, 0.35], 0.3, 0.3, 4).striped([0.7, 0.2, 1.0], 0.5, [0.15, 0.1, 0.0]);
    let half = DVec3::new(0.45, 0.45, 0.6);
    let cylinder = Shape::Cylinder {
        radius: 0.45,
        half_height: 0.4,
    };
    Scene {
        objects: vec![
            stage(),
            Object::new(Shape::Sphere(0.6), Material::matt(ball))
                .at(-1.3, -0.9, 0.6)
                .shading(0.6),
            Object::new(Shape::Cuboid(half), Material::matt(block))
                .turned(DMat3::from_rotation_z(0.5))
                .at(1.3, 0.9, 0.6)
                .shading(0.55),
            Object::new(cylinder, Material::matt(drum))
                .at(1.0, -1.4, 0.4)
                .shading(0.45),
        ],
        ..Scene::default()
    }
}

fn demo() -> Scene {
    let mut scene = solids();
    // The ball and the drum shine; the block stays matt for comparison.
    for (index, gloss, shininess) in [(1, 0.45, 14.0), (3, 0.25, 8.0)] {
        scene.objects[index].material.gloss = gloss;
        scene.objects[index].material.shininess = shininess;
    }
    let brass = Texture::ripples([0.72, 0.55, 0.22], 0.25, 0.35, 7);
    let tube = Shape::Mesh(MeshTree::new(&knot(0.26, 160, 16)));
    let pebble = Texture::ripples([0.45, 0.4, 0.5], 0.4, 0.25, 8);
    let round = Shape::Mesh(MeshTree::new(&icosphere(2)));
    scene.objects.extend([
        Object::new(tube, Material::glossy(brass, 0.35, 10.0))
            // Standing on one of its three lobes.
            .turned(DMat3::from_rotation_x(1.45))
            .scaled(0.55)
            .at(0.0, 0.0, 0.85)
            .shading(0.35),
        Object::new(round, Material::matt(pebble))
            .scaled(0.35)
            .at(-1.1, 1.4, 0.35)
            .shading(0.35),
    ]);
    scene
}

/// Small shapes of the intricate scene.
const SHAPES: usize = 200;

/// Ground that fills the pictures, shapes strewn over it by the golden angle, and two knots above them.
fn intricate() -> Scene {
    let random = &mut KeyedRandom::new(31, 0);
    let ground = Texture::ripples([0.5, 0.48, 0.45], 0.45, 0.13, 29)
        .striped([1.0, 0.6, 0.0], 0.31, [0.12, 0.08, 0.02])
        .striped([-0.5, 1.0, 0.0], 0.37, [0.03, 0.1, 0.12]);
    let mut objects = vec![Object::new(Shape::Disc(9.0), Material::matt(ground))];
    for i in 0..SHAPES {
        let size = random.between(0.07, 0.16);
        // Uniform over the disc, but for the middle with the knots.
        let place = DVec2::from_angle(i as f64 * GOLDEN_ANGLE) * (0.9 + 2.6 * (i as f64 / SHAPES as f64).sqrt());
        let base = DVec3::splat(0.45) + 0.3 * random.direction();
        let texture = Texture::ripples(base.to_array(), 0.4, 0.1, 100 + i as u64).striped(
            random.direction().to_array(),
            random.between(0.1, 0.2),
            (0.15 * random.direction()).to_array(),
        );
        let material = match i % 3 {
            0 => Material::glossy(texture, 0.5, random.between(6.0, 30.0)),
            _ => Material::matt(texture),
        };
        let shape = match i % 4 {
            0 => Shape::Sphere(1.0),
            1 => Shape::Cuboid(DVec3::new(0.8, 0.6, 1.0)),
            2 => Shape::Cylinder {
                radius: 0.6,
                half_height: 1.0,
            },
            _ => Shape::Cuboid(DVec3::new(0.25, 0.25, 1.0)),
        };
        objects.push(
            Object::new(shape, material)
                .turned(DMat3::from_rotation_z(random.between(0.0, 3.0)))
                .scaled(size)
                .at(place.x, place.y, size),
        );
    }
    objects.extend(knots());
    Scene {
        objects,
        ..Scene::default()
    }
}

/// Two shining tubes, one within the other.
fn knots() -> [Object; 2] {
    let texture =
        |seed| Texture::ripples([0.6, 0.5, 0.35], 0.35, 0.14, seed).striped([0.3, 1.0, 0.5], 0.16, [0.15, 0.1, 0.05]);
    [(0.45, 0.9, 41), (0.3, 1.5, 43)].map(|(size, height, seed)| {
        let tube = Shape::Mesh(MeshTree::new(&knot(0.2, 160, 16)));
        Object::new(tube, Material::glossy(texture(seed), 0.4, 12.0))
            .turned(DMat3::from_rotation_x(1.2))
            .scaled(size)
            .at(0.0, 0.0, height)
            .shading(size)
    })
}

/// Leaves of a crown.
const LEAVES: usize = 2500;

/// Crowns on rough ground.
fn foliage() -> Scene {
    let ground = Texture::ripples([0.42, 0.38, 0.3], 0.5, 0.12, 61);
    let mut objects = vec![Object::new(Shape::Disc(9.0), Material::matt(ground))];
    let crowns = [
        ([0.3, 0.5, 0.2], [-0.8, -0.5, 1.0], 0.95),
        ([0.45, 0.5, 0.15], [0.9, 0.1, 0.75], 0.7),
        ([0.5, 0.35, 0.2], [-0.2, 1.1, 0.65], 0.6),
    ];
    for (seed, (color, [x, y, z], size)) in (0..).zip(crowns) {
        // Wavelengths from about a leaf's length, so that each leaf has a shade of its own.
        let texture = Texture::ripples(color, 0.7, 0.1, 62 + seed);
        objects.push(
            Object::new(
                Shape::Mesh(MeshTree::new(&leaves(LEAVES, 0.16, seed))),
                Material::matt(texture),
            )
            .scaled(size)
            .at(x, y, z)
            .shading(0.7 * size),
        );
    }
    Scene {
        objects,
        ..Scene::default()
    }
}

/// A wall that fills the pictures, facing -y, with windows and sills in rows.
fn facade() -> Scene {
    let courses = Texture::ripples([0.6, 0.5, 0.42], 0.25, 0.1, 71)
        .striped([0.0, 1.0, 0.0], 0.12, [0.1, 0.09, 0.08])
        .striped([1.0, 0.0, 0.0], 0.27, [0.06, 0.05, 0.04]);
    let pane = Texture::ripples([0.2, 0.26, 0.33], 0.2, 0.15, 72).striped([1.0, 0.0, 0.0], 0.2, [0.15, 0.15, 0.14]);
    let stone = Texture::ripples([0.72, 0.7, 0.66], 0.2, 0.1, 73);
    let upright = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let wall = Shape::Rectangle(DVec2::splat(12.0));
    let mut objects = vec![Object::new(wall, Material::matt(courses)).turned(upright)];
    for i in 0..20 {
        let (x, z) = (0.95 * f64::from(i % 5 - 2), 1.2 * f64::from(i / 5) - 1.3);
        let window = Shape::Cuboid(DVec3::new(0.25, 0.03, 0.35));
        let sill = Shape::Cuboid(DVec3::new(0.34, 0.12, 0.05));
        objects.push(Object::new(window, Material::glossy(pane.clone(), 0.3, 20.0)).at(x, 0.0, z));
        objects.push(Object::new(sill, Material::matt(stone.clone())).at(x, -0.1, z - 0.42));
    }
    Scene {
        objects,
        rig: Rig {
            target: DVec3::new(0.0, 0.0, 0.5),
            distance: 4.5,
            azimuth_degrees: (-150.0, -30.0),
            elevation_degrees: (-20.0, 40.0),
        },
    }
}

/// A ball behind wires along the edges of an icosahedron divided once, of three thicknesses.
fn cage() -> Scene {
    let ball = Texture::ripples([0.4, 0.5, 0.6], 0.5, 0.2, 91);
    let wire = Texture::ripples([0.75, 0.6, 0.4], 0.4, 0.3, 92);
    let wires = wires(1, [0.004, 0.008, 0.012], 8);
    Scene {
        objects: vec![
            Object::new(Shape::Sphere(0.55), Material::matt(ball)).shading(0.55),
            Object::new(Shape::Mesh(MeshTree::new(&wires)), Material::matt(wire)),
        ],
        rig: Rig {
            target: DVec3::ZERO,
            distance: 3.2,
            ..Rig::default()
        },
    }
}

/// Angle between successive leaves of a spiral without rows, radians.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
