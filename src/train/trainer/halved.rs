//! The training views at half their size, for the first steps of a run: a quarter of the pixels to draw.

use super::{IN_FLIGHT, Photos, TrainConfig, Trainer};
use crate::Result;
use crate::gpu::Gpu;
use crate::io::photo;
use crate::scene::{AlphaMode, Dataset, PhotoSource, Split, View};
use rayon::prelude::*;

/// A data set of the named views alone, in that order, at half their width and height, rounded up.
fn halved(dataset: &Dataset, views: &[usize]) -> Result<Dataset> {
    let half = |length: u32| length.div_ceil(2).max(photo::SIDE_MIN).min(length);
    let view = |&index: &usize| {
        let view = &dataset.views[index];
        let (width, height) = (half(view.camera.width), half(view.camera.height));
        let photo = photo::reduce(photo::load(view)?, width, height);
        Ok(View {
            name: view.name.clone(),
            camera: view.camera.resized(width, height),
            photo: PhotoSource::Memory(photo),
        })
    };
    // Where undistorting left empty borders, alpha says so, whatever else it may mean.
    let has_border = |&index: &usize| {
        let photo = &dataset.views[index].photo;
        matches!(
            photo,
            PhotoSource::File {
                distortion: Some(_),
                ..
            }
        )
    };
    let masks = dataset.alpha == AlphaMode::Mask || views.iter().any(has_border);
    Ok(Dataset {
        views: views.par_iter().map(view).collect::<Result<_>>()?,
        alpha: match masks {
            true => AlphaMode::Mask,
            false => AlphaMode::Composite,
        },
        ..Dataset::default()
    })
}

/// What a run that goes on from an iteration begins with: the reduced views, if they are still to be seen, and
/// the photographs of those or of the whole ones.
pub(super) fn begin(
    gpu: &Gpu,
    dataset: &Dataset,
    views: &[usize],
    config: &TrainConfig,
    iteration: u32,
) -> Result<(Option<Dataset>, Photos)> {
    let share = config.photo_share;
    if iteration >= config.half_size_until {
        return Ok((None, Photos::new(gpu, dataset, views, IN_FLIGHT, share)?));
    }
    let half = halved(dataset, views)?;
    let photos = Photos::new(gpu, &half, &half.split(Split::All), IN_FLIGHT, share)?;
    Ok((Some(half), photos))
}

impl Trainer<'_> {
    /// Goes over to whole photographs when their time has come. A step that did not fit comes first, again.
    pub(super) fn enlarge(&mut self) -> Result<()> {
        if self.halved.is_some() && self.iteration >= self.config.half_size_until && self.drain()? {
            self.halved = None;
            let (dataset, share) = (self.dataset, self.config.photo_share);
            self.photos = Photos::new(&self.gpu, dataset, &self.views, IN_FLIGHT, share)?;
        }
        Ok(())
    }
}
