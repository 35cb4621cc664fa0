//! The scene drawn in views and matched with their photographs: a round of bundle adjustment, and resection.

use super::tracks::{ViewPair, moved, points, tracks};
use super::{RefinedPoses, bundle, resection};
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

/// Most drawings of a view whose pose is searched alone.
const RESECTIONS_MAX: usize = 6;

/// Views of a data set whose poses are moved to fit a scene to their photographs.
#[derive(Clone, Copy, Debug)]
pub struct PoseAdjustment<'a> {
    /// The data set.
    pub dataset: &'a Dataset,
    /// Indices of the views.
    pub views: &'a [usize],
    /// Scene extent, world units.
    pub extent: f64,
    /// Background, near plane and filter.
    pub options: ViewOptions,
}

impl PoseAdjustment<'_> {
    /// Moves poses to fit the scene to the photographs. Views are drawn for points and again for their places, so that
    /// one at a time is in memory.
    pub(in crate::train) fn adjust(&self, gpu: &Gpu, model: &Model, poses: &mut RefinedPoses) -> Result<()> {
        let mut renderer = surface_renderer(gpu, model)?;
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

    /// Camera of each view that fits its photograph to the scene, which is held; the given one where none fits better.
    ///
    /// Windows of the view's rendering are matched with the photograph, and the motion that explains their
    /// displacements is taken, up to five times, while the mean squared error falls. `progress` is called for each
    /// view.
    ///
    /// # Errors
    /// Those of a photograph that cannot be read, and of the device.
    pub fn resect(&self, gpu: &Gpu, model: &Model, mut progress: impl FnMut()) -> Result<Vec<Camera>> {
        let mut renderer = surface_renderer(gpu, model)?;
        let places = 0..self.views.len();
        let cameras: Result<Vec<Camera>> = places
            .map(|place| {
                progress();
                self.resected(&mut renderer, model, place)
            })
            .collect();
        renderer.release()?;
        cameras
    }

    fn resected(&self, renderer: &mut Renderer, model: &Model, place: usize) -> Result<Camera> {
        let given = &self.dataset.views[self.views[place]].camera;
        let [width, height] = drawn_size([given.width, given.height]);
        let mut camera = given.resized(width, height);
        let target = &self.target(place, &camera)?;
        let (mut least, mut best) = (f64::INFINITY, camera);
        for _ in 0..RESECTIONS_MAX {
            let rendered = &renderer.render(model, &camera, &self.options)?;
            let error = target.mean_squared_error(&rendered.rgb);
            if error.is_nan() || error >= least {
                break;
            }
            (least, best) = (error, camera);
            let pair = ViewPair {
                camera: &camera,
                rendered,
                target,
                photo: 0,
                extent: self.extent,
            };
            let seen = pair.observations(&points(&camera, rendered, 1.0));
            let Some(motion) = resection::motion(&seen.into_iter().flatten().collect::<Vec<_>>()) else {
                break;
            };
            camera = moved(&camera, self.extent, motion);
        }
        Ok(Camera {
            rotation: best.rotation,
            position: best.position,
            ..*given
        })
    }

    /// Photograph of a view at the size of a camera.
    fn target(&self, view: usize, camera: &Camera) -> Result<Target> {
        let photo = photo::load(&self.dataset.views[self.views[view]])?;
        let photo = photo::reduce(photo, camera.width, camera.height);
        Ok(Target::new(&photo, self.dataset.alpha, self.options.background))
    }
}

/// Renderer of pictures with depths.
fn surface_renderer(gpu: &Gpu, model: &Model) -> Result<Renderer> {
    let options = RenderOptions {
        with_surface: true,
        primitive: model.primitive,
        capacity: Capacity::LEAST,
        ..RenderOptions::default()
    };
    Renderer::new(gpu, options)
}

/// Width and height of a view when it is drawn: halved until at most [`PIXELS_MAX`] pixels are left.
pub(in crate::train) fn drawn_size([mut width, mut height]: [u32; 2]) -> [u32; 2] {
    while u64::from(width) * u64::from(height) > PIXELS_MAX {
        (width, height) = (photo::half(width), photo::half(height));
    }
    [width, height]
}
