//! A round of bundle adjustment: the scene drawn in each training view, and matched with its photograph.

use super::tracks::{ViewPair, points, tracks};
use super::{RefinedPoses, bundle};
use crate::Result;
use crate::gpu::Gpu;
use crate::io::photo;
use crate::metrics::Target;
use crate::render::{Capacity, Model, RenderOptions, RenderedImage, Renderer, ViewOptions};
use crate::scene::{Camera, Dataset};
use glam::DVec3;

/// Most pixels of a drawn view: those of larger photographs are halved.
const PIXELS_MAX: u64 = 1 << 20;

/// Views whose surfaces have enough points: of two and three times as many, every second and third has points.
const VIEWS_ENOUGH: usize = 12;

/// Training views of a run, and how its scene is drawn.
pub(in crate::train) struct PoseAdjustment<'a> {
    pub(in crate::train) dataset: &'a Dataset,
    pub(in crate::train) views: &'a [usize],
    pub(in crate::train) extent: f64,
    pub(in crate::train) options: ViewOptions,
}

impl PoseAdjustment<'_> {
    /// Moves poses to fit the scene to the photographs. Views are drawn for points and again for their places, so that
    /// one at a time is in memory.
    pub(in crate::train) fn adjust(&self, gpu: &Gpu, model: &Model, poses: &mut RefinedPoses) -> Result<()> {
        let options = RenderOptions {
            with_surface: true,
            primitive: model.primitive,
            capacity: Capacity::LEAST,
            ..RenderOptions::default()
        };
        let mut renderer = Renderer::new(gpu, options)?;
        let mut draw = |place: usize| -> Result<(Camera, RenderedImage)> {
            let given = &self.dataset.views[self.views[place]].camera;
            let [width, height] = drawn_size([given.width, given.height]);
            let camera = poses.refined(place, &given.resized(width, height));
            Ok((camera, renderer.render(model, &camera, &self.options)?))
        };
        let count = self.views.len();
        let mut places: Vec<DVec3> = Vec::new();
        let with_points = (0..count).step_by((count / VIEWS_ENOUGH).clamp(1, 3));
        let share = 1.0 / with_points.len() as f64;
        for view in with_points {
            let (camera, rendered) = draw(view)?;
            places.extend(points(&camera, &rendered, share));
        }
        let mut seen = Vec::with_capacity(count);
        for view in 0..count {
            let (camera, rendered) = &draw(view)?;
            let pair = ViewPair {
                camera,
                rendered,
                target: &self.target(view, camera)?,
                photo: poses.photo(view),
                extent: self.extent,
            };
            seen.push(pair.observations(&places));
        }
        renderer.release()?;
        poses.apply(&bundle::adjust(&poses.photos(), &tracks(&seen, places.len())));
        Ok(())
    }

    /// Photograph of a view at the size of a camera.
    fn target(&self, view: usize, camera: &Camera) -> Result<Target> {
        let photo = photo::load(&self.dataset.views[self.views[view]])?;
        let photo = photo::reduce(photo, camera.width, camera.height);
        Ok(Target::new(&photo, self.dataset.alpha, self.options.background))
    }
}

/// Width and height of a view when it is drawn: halved until at most [`PIXELS_MAX`] pixels are left.
pub(in crate::train) fn drawn_size([mut width, mut height]: [u32; 2]) -> [u32; 2] {
    while u64::from(width) * u64::from(height) > PIXELS_MAX {
        (width, height) = (photo::half(width), photo::half(height));
    }
    [width, height]
}
