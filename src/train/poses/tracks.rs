//! Points of the scene, and their places in the photographs.

use super::bundle::{Motion, PointObservation};
use super::windows::{BORDER, Pyramid, displacement};
use crate::metrics::Target;
use crate::render::RenderedImage;
use crate::scene::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

/// Points of all views together, about.
const POINTS: f64 = 1_500.0;
/// Difference of depths on one surface, as a share.
const DEPTH_TOLERANCE: f32 = 0.02;
/// Photographs that must show a point.
const PHOTOS_MIN: usize = 3;

/// A share of all points, on a rendering's surfaces: where contrast is highest in each cell of a grid.
pub(super) fn points(camera: &Camera, rendered: &RenderedImage, share: f64) -> Vec<DVec3> {
    let Some(surface) = &rendered.surface else {
        return Vec::new();
    };
    let (width, depth) = (rendered.width as usize, &surface.median_depth);
    let light = |i: usize| rendered.rgb[i].iter().sum::<f32>();
    let contrast = |x: usize, y: usize| {
        let i = y * width + x;
        let around = [i - width, i - 1, i, i + 1, i + width];
        let is_smooth = around.iter().all(|&j| is_on_surface(depth[j], depth[i]));
        let slopes = [light(i + 1) - light(i - 1), light(i + width) - light(i - width)];
        is_smooth.then(|| slopes.iter().map(|slope| slope * slope).sum::<f32>())
    };
    let grid = ((POINTS * share).sqrt().round() as u32).max(1);
    let cell = |index: u32| {
        let [columns, rows] = [(index % grid, rendered.width), (index / grid, rendered.height)].map(|(place, size)| {
            let edge = |place: u32| (place * size / grid).clamp(BORDER, size.saturating_sub(BORDER).max(BORDER));
            edge(place)..edge(place + 1)
        });
        let places = rows.flat_map(|y| columns.clone().map(move |x| (x as usize, y as usize)));
        let rated = places.filter_map(|(x, y)| Some((contrast(x, y)?, x, y)));
        let (_, x, y) = rated.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let ray = camera.ray_from_pixel(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        Some(camera.position + ray * f64::from(depth[y * width + x]))
    };
    (0..grid * grid).filter_map(cell).collect()
}

/// Whether two depths are of one surface; not where one is NaN.
fn is_on_surface(depth: f32, other: f32) -> bool {
    (depth / other - 1.0).abs() < DEPTH_TOLERANCE
}

/// A view drawn as the scene is now, and its photograph of the same size.
pub(super) struct ViewPair<'v> {
    pub(super) camera: &'v Camera,
    pub(super) rendered: &'v RenderedImage,
    pub(super) target: &'v Target,
    /// Photograph of the view.
    pub(super) photo: usize,
    pub(super) extent: f64,
}

impl ViewPair<'_> {
    /// Observation of each point; `None` for points that the view hides or the photograph does not match.
    pub(super) fn observations(&self, points: &[DVec3]) -> Vec<Option<PointObservation>> {
        let pyramids = [&self.rendered.rgb, &self.target.rgb].map(|rgb| Pyramid::of(rgb, self.rendered.width));
        let observe = |point: &DVec3| self.observe(*point, &pyramids);
        points.par_iter().map(observe).collect()
    }

    fn observe(&self, point: DVec3, [rendering, photo]: &[Pyramid; 2]) -> Option<PointObservation> {
        let size = DVec2::new(self.camera.width.into(), self.camera.height.into());
        let border = f64::from(BORDER);
        let is_inside = |place: DVec2| place.cmpge(DVec2::splat(border)).all() && place.cmplt(size - border).all();
        let place = self.camera.pixel_from_world(point).filter(|place| is_inside(*place))?;
        let index = place.y as usize * self.camera.width as usize + place.x as usize;
        let depth = self.camera.view_from_world(point).z as f32;
        let surface = self.rendered.surface.as_ref()?;
        let weight = self.target.weights.as_ref().map_or(1.0, |weights| weights[index]);
        if !is_on_surface(surface.median_depth[index], depth) || weight < 0.5 {
            return None;
        }
        let found = displacement(rendering, photo, place)?;
        let (by_motion, by_point) = derivatives(self.camera, self.extent, point);
        let rows = [0, 1].map(|row| found.whitening.row(row));
        Some(PointObservation {
            photo: self.photo,
            by_motion: rows.map(|row| std::array::from_fn(|k| row.x * by_motion[0][k] + row.y * by_motion[1][k])),
            by_point: rows.map(|row| by_point[0] * row.x + by_point[1] * row.y),
            displacement: rows.map(|row| row.dot(found.pixels)),
        })
    }
}

/// Derivatives of a point's pixel, x then y: by the camera's motion, and by the point's place in scene extents.
pub(super) fn derivatives(camera: &Camera, extent: f64, point: DVec3) -> ([Motion; 2], [DVec3; 2]) {
    let at = camera.view_from_world(point);
    let from_camera = point - camera.position;
    let rows = [
        DVec3::new(1.0, 0.0, -at.x / at.z) * (camera.focal.x / at.z),
        DVec3::new(0.0, 1.0, -at.y / at.z) * (camera.focal.y / at.z),
    ];
    let by_point = rows.map(|row| camera.rotation.transpose() * row);
    let by_motion = by_point.map(|row| {
        // The world turns about the camera; its centre moves the other way than points.
        let (turn, shift) = (from_camera.cross(row), -extent * row);
        [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
    });
    (by_motion, by_point.map(|row| extent * row))
}

/// A camera turned about its centre and shifted.
pub(super) fn moved(camera: &Camera, extent: f64, [x, y, z, shift @ ..]: Motion) -> Camera {
    let turn = DQuat::from_scaled_axis(DVec3::new(x, y, z));
    Camera {
        rotation: camera.rotation * DMat3::from_quat(turn),
        position: camera.position + extent * DVec3::from(shift),
        ..*camera
    }
}

/// Observations of each point that enough photographs show, from those of each view.
pub(super) fn tracks(views: &[Vec<Option<PointObservation>>], points: usize) -> Vec<Vec<PointObservation>> {
    let track = |point: usize| views.iter().filter_map(|view| view[point]).collect::<Vec<_>>();
    (0..points)
        .map(track)
        .filter(|track| track.len() >= PHOTOS_MIN)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::test_camera;

    #[test]
    fn derivatives_are_the_limits_of_differences() {
        let (extent, point) = (5.0, DVec3::new(0.4, -0.3, 0.2));
        let camera = test_camera(160, 120, 170.0).look_at(DVec3::new(1.0, -2.0, -4.0), DVec3::ZERO, DVec3::NEG_Y);
        let (by_motion, by_point) = derivatives(&camera, extent, point);
        let step = 1e-6;
        let slope = |ahead: Option<DVec2>, behind: Option<DVec2>| (ahead.unwrap() - behind.unwrap()) / (2.0 * step);
        for (k, found) in by_motion[0].into_iter().zip(by_motion[1]).enumerate() {
            let unit: Motion = std::array::from_fn(|i| if i == k { step } else { 0.0 });
            let [ahead, behind] =
                [unit, unit.map(|x| -x)].map(|motion| moved(&camera, extent, motion).pixel_from_world(point));
            assert!(slope(ahead, behind).distance(found.into()) < 1e-4, "{k}: {found:?}");
        }
        for axis in DVec3::AXES {
            let shift = axis * (step * extent);
            let [ahead, behind] = [shift, -shift].map(|shift| camera.pixel_from_world(point + shift));
            let found = DVec2::new(by_point[0].dot(axis), by_point[1].dot(axis));
            assert!(slope(ahead, behind).distance(found) < 1e-4, "{axis}: {found}");
        }
    }
}
