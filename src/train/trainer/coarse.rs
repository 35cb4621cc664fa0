//! Training views of reduced size, coarse to fine: for the first steps of a run.

use super::{IN_FLIGHT, Photos, TrainConfig, Trainer};
use crate::Result;
use crate::gpu::Gpu;
use crate::io::parallel::try_map;
use crate::io::photo;
use crate::scene::{Dataset, PhotoSource, Split, View};
use crate::train::schedule;
use rayon::prelude::*;

/// Training views at a fraction of their size.
pub(super) struct Coarse {
    /// The views alone, in the order of the trainer's.
    pub(super) dataset: Dataset,
    /// Halvings of their width and height, 1 or more.
    pub(super) halvings: u32,
}

impl Coarse {
    /// These views of a data set, with width and height halved so many times, rounded up.
    fn new(dataset: &Dataset, views: &[usize], halvings: u32) -> Result<Coarse> {
        let view = |&index: &usize| {
            let view = &dataset.views[index];
            let reduced = |length| (0..halvings).fold(length, |length, _| photo::half(length));
            let [width, height] = [view.camera.width, view.camera.height].map(reduced);
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
        Ok(Coarse {
            dataset: Dataset {
                views: try_map(views.par_iter(), view)?,
                alpha: dataset.alpha,
                ..Dataset::default()
            },
            halvings,
        })
    }
}

/// The reduced views, if there are `halvings`, and the photographs of those or of the full-size ones.
pub(super) fn begin(
    gpu: &Gpu,
    dataset: &Dataset,
    views: &[usize],
    config: &TrainConfig,
    halvings: u32,
) -> Result<(Option<Coarse>, Photos)> {
    let share = config.photo_share;
    if halvings == 0 {
        return Ok((None, Photos::new(gpu, dataset, views, IN_FLIGHT, share)?));
    }
    let coarse = Coarse::new(dataset, views, halvings)?;
    let all = coarse.dataset.split(Split::All);
    let photos = Photos::new(gpu, &coarse.dataset, &all, IN_FLIGHT, share)?;
    Ok((Some(coarse), photos))
}

impl Trainer<'_> {
    /// Halvings of the photographs in the next step.
    fn halvings(&self) -> u32 {
        schedule::halvings(&self.config, self.iteration)
    }

    /// Changes to larger photographs when due, and loads them where that has failed. A step that did not fit is
    /// repeated first.
    pub(super) fn enlarge(&mut self) -> Result<()> {
        let halvings = |coarse: &Coarse| coarse.halvings;
        let is_due = self.photos.is_empty() || self.coarse.as_ref().map_or(0, halvings) != self.halvings();
        if is_due && self.drain()? {
            self.reload(self.views.clone())?;
        }
        Ok(())
    }

    /// Trains on the photographs of these views from now on. No step may be in flight.
    pub(super) fn reload(&mut self, views: Vec<usize>) -> Result<()> {
        // Memory never holds both.
        self.frames.release()?;
        self.photos = Photos::none();
        (self.coarse, self.photos) = begin(&self.gpu, self.dataset, &views, &self.config, self.halvings())?;
        self.views = views;
        Ok(())
    }
}
