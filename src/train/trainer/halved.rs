//! Training views at half size, with a quarter of the pixels: for the first steps of a run, or while its controller
//! sets it.

use super::{IN_FLIGHT, Photos, TrainConfig, Trainer};
use crate::Result;
use crate::gpu::Gpu;
use crate::io::photo;
use crate::scene::{Dataset, PhotoSource, Split, View};
use rayon::prelude::*;

/// Data set of these views alone, in that order, at half their width and height, rounded up.
fn halved(dataset: &Dataset, views: &[usize]) -> Result<Dataset> {
    let view = |&index: &usize| {
        let view = &dataset.views[index];
        let [width, height] = [view.camera.width, view.camera.height].map(photo::half);
        Ok(View {
            name: view.name.clone(),
            camera: view.camera.resized(width, height),
            photo: match &view.photo {
                // Reduced on each read: together they may exceed the memory.
                PhotoSource::File { .. } => view.photo.clone(),
                _ => PhotoSource::Memory(photo::reduce(photo::load(view)?, width, height)),
            },
        })
    };
    Ok(Dataset {
        views: views.par_iter().map(view).collect::<Result<_>>()?,
        alpha: dataset.alpha,
        ..Dataset::default()
    })
}

/// The reduced views if `is_half`, and the photographs of those or of the full-size ones.
pub(super) fn begin(
    gpu: &Gpu,
    dataset: &Dataset,
    views: &[usize],
    config: &TrainConfig,
    is_half: bool,
) -> Result<(Option<Dataset>, Photos)> {
    let share = config.photo_share;
    if !is_half {
        return Ok((None, Photos::new(gpu, dataset, views, IN_FLIGHT, share)?));
    }
    let half = halved(dataset, views)?;
    let photos = Photos::new(gpu, &half, &half.split(Split::All), IN_FLIGHT, share)?;
    Ok((Some(half), photos))
}

impl Trainer<'_> {
    /// Whether the next step uses half-size photographs.
    pub(super) fn is_half(&self) -> bool {
        self.iteration < self.config.half_size_until
    }

    /// Changes to full-size photographs when due. A step that did not fit is repeated first.
    pub(super) fn enlarge(&mut self) -> Result<()> {
        if self.halved.is_some() && !self.is_half() && self.drain()? {
            self.reload(self.views.clone())?;
        }
        Ok(())
    }

    /// Trains on the photographs of these views from now on. No step may be in flight.
    pub(super) fn reload(&mut self, views: Vec<usize>) -> Result<()> {
        let is_half = self.is_half();
        (self.halved, self.photos) = begin(&self.gpu, self.dataset, &views, &self.config, is_half)?;
        self.views = views;
        Ok(())
    }
}
