//! Views of an export: directions by which harmonics are rounded, and pictures by which files are compared.

use super::ExportArgs;
use crate::cli::engine::{self, evaluator};
use crate::cli::interrupt::Interrupt;
use crate::cli::render::orbit;
use crate::export::{Influence, Pictures};
use crate::gpu::Gpu;
use crate::render::{Compatibility, ViewOptions};
use crate::scene::{Camera, Dataset, PhotoSource, Splats, Split};
use crate::simplify::PassOptions;
use crate::train::TrainConfig;
use crate::{Error, Result};
use std::path::Path;

/// Views by whose directions harmonics are rounded, at most.
const DIRECTIONS_MAX: usize = 48;

/// Views that are rendered to compare settings, at most.
const COMPARED_MAX: usize = 8;

/// Most pixels of a picture by which settings are compared.
const COMPARED_PIXELS_MAX: f64 = 1e6;

/// Views on a sphere around a scene without cameras.
const SPHERE_VIEWS: u32 = 24;

/// Cameras of an export.
pub(super) struct Views<'a> {
    dataset: Option<&'a Dataset>,
    /// Training views, or those on a sphere.
    cameras: Vec<Camera>,
    /// Indices in the data set, if there is one.
    indices: Vec<usize>,
    options: ViewOptions,
}

impl<'a> Views<'a> {
    pub(super) fn new(args: &ExportArgs, dataset: Option<&'a Dataset>, splats: &Splats) -> Result<Views<'a>> {
        let (near, cameras, indices) = match dataset {
            Some(dataset) => {
                let indices = dataset.split(Split::Train);
                if indices.is_empty() {
                    let path = args.data.as_deref().unwrap_or(Path::new("."));
                    return Err(Error::file(path, "holds no training view"));
                }
                let cameras = indices.iter().map(|&i| dataset.views[i].camera).collect();
                (engine::near(dataset), cameras, indices)
            }
            None => {
                let near = orbit::radius(splats) * f64::from(TrainConfig::default().near_factor);
                (near, orbit::sphere_of_splats(splats, SPHERE_VIEWS), Vec::new())
            }
        };
        Ok(Views {
            dataset,
            cameras,
            indices,
            options: ViewOptions {
                background: args.background,
                near: near as f32,
                filter: splats.filter,
            },
        })
    }

    /// Weights of the splats in the views.
    pub(super) fn influence(&self, gpu: &Gpu, splats: &Splats, interrupt: &Interrupt) -> Result<Option<Influence>> {
        let options = PassOptions {
            near: self.options.near,
            background: self.options.background,
            compatibility: Compatibility::Engine,
        };
        let cameras: Vec<Camera> = spread(self.cameras.len(), DIRECTIONS_MAX)
            .map(|i| self.cameras[i])
            .collect();
        Influence::measure(gpu, splats, &cameras, options, || !interrupt.is_requested())
    }

    /// Pictures by which settings are compared.
    pub(super) fn pictures(&self, gpu: &Gpu, splats: &Splats) -> Result<Pictures<'a>> {
        let chosen: Vec<usize> = spread(self.cameras.len(), COMPARED_MAX).collect();
        let photos = self.dataset.and_then(|dataset| {
            let indices: Vec<usize> = chosen.iter().map(|&i| self.indices[i]).collect();
            let is_there = |&i: &usize| !matches!(dataset.views[i].photo, PhotoSource::Absent);
            let all = indices.iter().all(is_there);
            all.then(|| evaluator(gpu, dataset, &indices, self.options.background))
        });
        let cameras = chosen.iter().map(|&i| small(&self.cameras[i])).collect();
        Pictures::new(gpu, splats, cameras, self.options, photos)
    }
}

/// Up to `most` of the numbers below `count`, evenly spread.
fn spread(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let chosen = count.min(most);
    (0..chosen).map(move |i| (2 * i + 1) * count / (2 * chosen))
}

/// The same view in a picture of limited size.
fn small(camera: &Camera) -> Camera {
    let pixels = f64::from(camera.width) * f64::from(camera.height);
    let scale = (COMPARED_PIXELS_MAX / pixels).sqrt().min(1.0);
    let side = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
    camera.resized(side(camera.width), side(camera.height))
}
