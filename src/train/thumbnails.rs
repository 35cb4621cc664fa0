//! Reduced photographs of the training views, for first splats.

use crate::Result;
use crate::io::parallel::try_map;
use crate::io::photo;
use crate::scene::{Camera, Dataset, Photo};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Longest side of a reduced photograph, pixels.
const SIDE: f64 = 200.0;

/// A photograph, reduced, and its camera.
pub(super) struct ReducedPhoto {
    pub(super) camera: Camera,
    pub(super) photo: Photo,
}

impl ReducedPhoto {
    /// Those of these views.
    pub(super) fn all(dataset: &Dataset, views: &[usize]) -> Result<Vec<ReducedPhoto>> {
        try_map(views.par_iter(), |&view| ReducedPhoto::of(dataset, view))
    }

    fn of(dataset: &Dataset, view: usize) -> Result<ReducedPhoto> {
        let view = &dataset.views[view];
        let longest = f64::from(view.camera.width.max(view.camera.height));
        let ratio = (SIDE / longest).min(1.0);
        let side = |length: u32| ((f64::from(length) * ratio).round() as u32).max(1);
        let (width, height) = (side(view.camera.width), side(view.camera.height));
        Ok(ReducedPhoto {
            camera: view.camera.resized(width, height),
            photo: photo::reduce(photo::load(view)?, width, height),
        })
    }

    /// Colour at a place in pixels, if it lies within and counts.
    pub(super) fn color(&self, place: DVec2) -> Option<DVec3> {
        let (width, height) = (self.photo.width, self.photo.height);
        let is_inside = place.cmpge(DVec2::ZERO).all() && place.x < width.into() && place.y < height.into();
        let index = is_inside.then(|| place.y as usize * width as usize + place.x as usize)?;
        let [r, g, b, alpha] = self.photo.rgba[index];
        (alpha >= 128).then(|| DVec3::new(r.into(), g.into(), b.into()) / 255.0)
    }
}
