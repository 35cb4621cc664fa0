//! Synthetic scenes with exact photographs, depth, normals and points: ground truth for the demo and for tests.
//!
//! Rays are cast with rayon at analytic shapes and at triangle meshes; photographs are averages over a grid of samples
//! in each pixel. World: z up. A ray without a hit is black.
//!
//! **Invariant:** no device and no files; the same arguments give the same bytes.

mod colmap;
mod composition;
mod dataset;
mod fisheye;
mod material;
mod mesh;
mod model;
mod noise;
mod passerby;
mod perturb;
mod random;
mod ray;
mod save;
mod shape;
mod triangulate;

#[cfg(test)]
mod tests;

pub use colmap::{save_colmap, save_masks, save_model};
pub use composition::{Kind, of_mesh, scene};
pub use dataset::{Rig, SynthOptions};
pub use fisheye::FisheyeLens;
pub use material::{Material, Texture};
pub use mesh::MeshTree;
pub use model::{icosphere, knot, leaves, wires};
pub use save::save;
pub use shape::Shape;

use crate::scene::{Camera, Photo};
use glam::{DMat3, DVec2, DVec3};
use material::Color;
use ray::{Hit, Ray};
use rayon::prelude::*;

/// Least distance of a hit from a ray's start, in lengths of its direction, against hits of the surface it leaves.
const CLEARANCE: f64 = 1e-6;

/// A shape with a pose and a material.
#[derive(Clone, Debug)]
pub struct Object {
    /// Shape around its own origin.
    pub shape: Shape,
    /// Material.
    pub material: Material,
    /// `world_from_local`, orthonormal.
    pub rotation: DMat3,
    /// World units per local unit.
    pub scale: f64,
    /// Position of its origin in the world.
    pub position: DVec3,
    /// Radius in world units of the sphere that shades other objects; 0: none.
    pub shading_radius: f64,
}

impl Object {
    /// Object at the origin, without rotation and without shading others.
    pub fn new(shape: Shape, material: Material) -> Object {
        Object {
            shape,
            material,
            rotation: DMat3::IDENTITY,
            scale: 1.0,
            position: DVec3::ZERO,
            shading_radius: 0.0,
        }
    }

    /// Moves the origin.
    pub fn at(self, x: f64, y: f64, z: f64) -> Object {
        let position = DVec3::new(x, y, z);
        Object { position, ..self }
    }

    /// Sets the rotation `world_from_local`.
    pub fn turned(self, rotation: DMat3) -> Object {
        Object { rotation, ..self }
    }

    /// Sets the scale.
    pub fn scaled(self, scale: f64) -> Object {
        Object { scale, ..self }
    }

    /// Sets the shading radius.
    pub fn shading(self, shading_radius: f64) -> Object {
        Object { shading_radius, ..self }
    }

    fn local_from_world(&self, point: DVec3) -> DVec3 {
        self.rotation.transpose() * (point - self.position) / self.scale
    }

    /// Distances along the ray are the same in local coordinates, because its direction is scaled too.
    fn hit(&self, ray: &Ray, t_min: f64, t_max: f64) -> Option<Hit> {
        // Bounding spheres reject most rays.
        let away = self.position - ray.origin;
        let radius = self.scale * self.shape.bounding_radius();
        if away.cross(ray.direction).length_squared() > radius * radius * ray.direction.length_squared() {
            return None;
        }
        let local = Ray {
            origin: self.local_from_world(ray.origin),
            direction: self.rotation.transpose() * ray.direction / self.scale,
        };
        let hit = self.shape.hit(&local, t_min, t_max)?;
        let towards = |normal: DVec3| {
            let normal = self.rotation * normal;
            if normal.dot(ray.direction) > 0.0 {
                -normal
            } else {
                normal
            }
        };
        Some(Hit {
            t: hit.t,
            normal: towards(hit.normal),
            shading_normal: towards(hit.shading_normal),
        })
    }
}

/// Objects under a lamp and a sky, before black.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Objects.
    pub objects: Vec<Object>,
    /// Rig of the cameras.
    pub rig: Rig,
}

impl Scene {
    /// The nearest hit, and the index of its object.
    fn hit(&self, ray: &Ray, t_max: f64) -> Option<(usize, Hit)> {
        let mut nearest: Option<(usize, Hit)> = None;
        for (index, object) in self.objects.iter().enumerate() {
            let limit = nearest.map_or(t_max, |(_, hit)| hit.t);
            nearest = object.hit(ray, CLEARANCE, limit).map(|hit| (index, hit)).or(nearest);
        }
        nearest
    }

    /// Colour of the ray's hit, if any.
    fn color(&self, ray: &Ray) -> Option<Color> {
        let (index, hit) = self.hit(ray, f64::INFINITY)?;
        let (object, point) = (&self.objects[index], ray.at(hit.t));
        let local = object.scale * object.local_from_world(point);
        let (normal, incident) = (hit.shading_normal, ray.direction.normalize());
        let openness = self.openness(index, point, normal);
        Some(object.material.shade(local, normal, incident, openness))
    }

    /// Share of ambient light that the other objects let through: each covers (radius / distance)² of a cosine-weighted
    /// sky, as a sphere above the horizon does. Such shadows have no edges and need no rays.
    fn openness(&self, index: usize, point: DVec3, normal: DVec3) -> f64 {
        let mut open = 1.0;
        for (i, object) in self.objects.iter().enumerate() {
            if i != index && object.shading_radius > 0.0 {
                let away = object.position - point;
                let distance = away.length().max(object.shading_radius);
                let facing = (away.dot(normal) / distance).max(0.0);
                open *= 1.0 - 0.85 * facing * (object.shading_radius / distance).powi(2);
            }
        }
        open
    }

    /// A value for each pixel, rows from the top, rows in parallel.
    fn per_pixel<T: Send>(camera: &Camera, value: impl Fn(DVec2) -> T + Sync) -> Vec<T> {
        let row = |y: u32| (0..camera.width).map(move |x| DVec2::new(x.into(), y.into()));
        let rows = (0..camera.height).into_par_iter();
        rows.flat_map_iter(|y| row(y).map(&value)).collect()
    }

    fn ray(camera: &Camera, pixel: DVec2) -> Ray {
        Ray {
            origin: camera.position,
            direction: camera.ray_from_pixel(pixel),
        }
    }

    /// Colour before black, and covered share of each pixel: means over a grid of `samples` × `samples` points
    /// in each pixel.
    fn coverage(&self, camera: &Camera, samples: u32) -> Vec<(Color, f64)> {
        let step = 1.0 / f64::from(samples);
        Self::per_pixel(camera, |corner| {
            let (mut sum, mut met) = (DVec3::ZERO, 0.0);
            for i in 0..samples * samples {
                let offset = DVec2::new((i % samples).into(), (i / samples).into()) + 0.5;
                if let Some(color) = self.color(&Self::ray(camera, corner + step * offset)) {
                    sum += color;
                    met += 1.0;
                }
            }
            (sum * step * step, met * step * step)
        })
    }

    /// Unrounded picture, `[row][column]` from the top: each pixel the mean of `samples` × `samples` rays.
    pub fn image(&self, camera: &Camera, samples: u32) -> Vec<[f32; 3]> {
        let pixels = self.coverage(camera, samples).into_iter();
        pixels.map(|(color, _)| color.as_vec3().to_array()).collect()
    }

    /// An opaque photograph, `samples` × `samples` rays a pixel.
    pub fn photo(&self, camera: &Camera, samples: u32) -> Photo {
        Photo::from_rgb(camera.width, camera.height, &self.image(camera, samples))
    }

    /// A photograph with the covered share of each pixel as straight alpha (colours are not multiplied by it, as in PNG
    /// files).
    pub fn cutout(&self, camera: &Camera, samples: u32) -> Photo {
        let straight = |(color, covered): (Color, f64)| {
            let [r, g, b] = (color / covered.max(1e-9)).as_vec3().to_array().map(Photo::level);
            [r, g, b, Photo::level(covered as f32)]
        };
        let pixels = self.coverage(camera, samples).into_iter();
        Photo {
            width: camera.width,
            height: camera.height,
            rgba: pixels.map(straight).collect(),
        }
    }

    /// View-space z (world units along the optical axis, not along the ray) of the surface at each pixel's centre;
    /// infinite without a surface.
    pub fn depth(&self, camera: &Camera) -> Vec<f32> {
        // Rays have view z = 1, so that distances along them are depths.
        Self::per_pixel(camera, |corner| {
            let hit = self.hit(&Self::ray(camera, corner + 0.5), f64::INFINITY);
            hit.map_or(f32::INFINITY, |(_, hit)| hit.t as f32)
        })
    }

    /// Unit normal of the surface in the world at each pixel's centre, towards the camera; zero without a surface.
    /// Normals of meshes are those of the flat triangles.
    pub fn normals(&self, camera: &Camera) -> Vec<[f32; 3]> {
        Self::per_pixel(camera, |corner| {
            let hit = self.hit(&Self::ray(camera, corner + 0.5), f64::INFINITY);
            hit.map_or([0.0; 3], |(_, hit)| hit.normal.as_vec3().to_array())
        })
    }
}
