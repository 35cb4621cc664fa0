//! Passers-by: an opaque box before the scene in some of the training photographs, another one in each.

use super::random::KeyedRandom;
use super::shape::Shape;
use super::{Material, Object, Scene, SynthOptions, Texture};
use crate::scene::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};

/// Share of the training photographs with a box.
const PHOTOS: f64 = 0.2;

/// Least and largest share of a photograph that its box covers.
const AREA: [f64; 2] = [0.05, 0.15];

/// Distance of a box, relative to that of the rig from its target.
const DISTANCE: f64 = 0.35;

/// Columns and rows of rays that measure the area of a box.
const RAYS: [u32; 2] = [64, 48];

/// Sets the stream apart from those of points, exposures and poses.
const STREAM: u64 = 0xb0c5;

impl SynthOptions {
    /// Views with a passer-by: a fifth of the training views, at random, by `transient_seed`.
    pub fn occluded(&self) -> Vec<usize> {
        let Some(seed) = self.transient_seed else {
            return Vec::new();
        };
        let mut training: Vec<(f64, usize)> = (0..self.views)
            .filter(|&view| !self.is_test(view))
            .map(|view| (KeyedRandom::new(seed ^ STREAM, view as u64).uniform(), view))
            .collect();
        training.sort_by(|a, b| a.0.total_cmp(&b.0));
        training.truncate((PHOTOS * training.len() as f64).round() as usize);
        let mut views: Vec<usize> = training.into_iter().map(|(_, view)| view).collect();
        views.sort_unstable();
        views
    }
}

impl Scene {
    /// The scene behind the passer-by of a view.
    pub(super) fn with_passerby(&self, camera: &Camera, seed: u64, view: usize) -> Scene {
        let mut scene = self.clone();
        scene.objects.push(passerby(camera, self.rig.distance, seed, view));
        scene
    }

    /// Pixels, `[row][column]`, that a view's passer-by covers in part or wholly; empty for views without one.
    pub fn passerby_pixels(&self, options: &SynthOptions, view: usize) -> Vec<bool> {
        let Some(seed) = options.transient_seed.filter(|_| options.occluded().contains(&view)) else {
            return Vec::new();
        };
        let camera = &self.cameras(options)[view];
        let scene = Scene {
            objects: vec![passerby(camera, self.rig.distance, seed, view)],
            rig: self.rig,
        };
        let cover = scene.coverage(camera, options.samples).into_iter();
        cover.map(|(_, covered)| covered > 0.0).collect()
    }
}

/// The box of a view: somewhere before the camera, turned at random, of the size that covers its share.
fn passerby(camera: &Camera, rig_distance: f64, seed: u64, view: usize) -> Object {
    let random = &mut KeyedRandom::new(seed ^ !STREAM, view as u64);
    let share = random.between(AREA[0], AREA[1]);
    let place = DVec2::new(random.between(0.2, 0.8), random.between(0.2, 0.8));
    let size = DVec2::new(camera.width.into(), camera.height.into());
    let position = camera.position + DISTANCE * rig_distance * camera.ray_from_pixel(place * size);
    let half = DVec3::from([(); 3].map(|()| random.between(0.5, 1.0)));
    let turn = DQuat::from_axis_angle(random.direction(), random.between(0.0, std::f64::consts::PI));
    let mut color = || [(); 3].map(|()| random.between(0.15, 0.85));
    let (base, stripes) = (color(), color().map(|c| 0.3 * (c - 0.5)));
    // Wavelengths are in world units: from a seventh of the box.
    let width = rig_distance * DISTANCE * share.sqrt() / 2.0;
    let texture = Texture::ripples(base, 0.6, width / 3.0, seed ^ view as u64).striped([1.0, 0.3, 0.2], width, stripes);
    let object = |scale: f64| {
        let object = Object::new(Shape::Cuboid(half), Material::matt(texture.clone()));
        let object = object.turned(DMat3::from_quat(turn)).scaled(scale);
        object.at(position.x, position.y, position.z)
    };
    let (mut low, mut high) = (0.0, 0.5 * rig_distance * DISTANCE);
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        match area(camera, &object(middle)) < share {
            true => low = middle,
            false => high = middle,
        }
    }
    object(high)
}

/// Share of a photograph that an object covers.
fn area(camera: &Camera, object: &Object) -> f64 {
    let size = DVec2::new(camera.width.into(), camera.height.into());
    let [columns, rows] = RAYS;
    let hits = (0..columns * rows).filter(|i| {
        let cell = DVec2::new((i % columns).into(), (i / columns).into()) + 0.5;
        let pixel = cell / DVec2::new(columns.into(), rows.into()) * size;
        object.hit(&Scene::ray(camera, pixel), 0.0, f64::INFINITY).is_some()
    });
    hits.count() as f64 / f64::from(columns * rows)
}
