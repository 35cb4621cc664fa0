//! Colours of the sparse points in the photographs.

use super::CURVE_OFFSET;
use super::fit::Observation;
use crate::Result;
use crate::io::parallel::try_map;
use crate::io::photo;
use crate::scene::{Dataset, PhotoSource, Split, View, Vignetting};
use glam::DVec3;
use rayon::prelude::*;

/// Values of an observation: outside of these, the sensor or the curve's toe says little.
const VALUES: std::ops::Range<f64> = 0.05..0.97;

/// Colours of points in the training photographs that show them; test views take no part.
#[derive(Debug)]
pub struct TrackColors {
    /// Photographs in the order of their views; none without tracks.
    pub(super) photos: Vec<PhotoColors>,
    /// Number of points.
    pub(super) points: usize,
}

/// Colours of points in a photograph.
#[derive(Debug)]
pub(super) struct PhotoColors {
    /// Index of the view in the data set.
    pub(super) view: usize,
    /// Width and height of a whole photograph; `None` for a side.
    pub(super) lens: Option<[u32; 2]>,
    patches: Vec<PatchColor>,
}

/// Mean over 3 × 3 pixels about a point.
#[derive(Debug)]
pub(super) struct PatchColor {
    pub(super) point: usize,
    /// Values of the channels.
    values: [f64; 3],
    /// q and q² of the place in the picture.
    powers: [f64; 2],
    /// Unit vector from the point to the camera.
    pub(super) direction: DVec3,
}

impl TrackColors {
    /// Decodes the photographs.
    ///
    /// # Errors
    /// Those of a photograph that cannot be read.
    pub fn read(dataset: &Dataset) -> Result<TrackColors> {
        let has_photo = |&view: &usize| !matches!(dataset.views[view].photo, PhotoSource::Absent);
        let mut views = dataset.split(Split::Train);
        views.retain(|view| has_photo(view) && !dataset.tracks.is_empty());
        Ok(TrackColors {
            photos: try_map(views.par_iter(), |&view| PhotoColors::read(dataset, view))?,
            points: dataset.points.len(),
        })
    }

    /// Observations of a channel; `lens` counts the lenses with vignetting as an unknown, `point` the points.
    pub(super) fn observations(
        &self,
        channel: usize,
        lens: impl Fn(&PhotoColors) -> Option<usize>,
        mut point: impl FnMut(&PatchColor) -> usize,
    ) -> Vec<Observation> {
        let mut all = Vec::new();
        for (photo, colors) in self.photos.iter().enumerate() {
            let lens = lens(colors);
            let known = colors
                .patches
                .iter()
                .filter(|patch| VALUES.contains(&patch.values[channel]));
            all.extend(known.map(|patch| Observation {
                photo,
                point: point(patch),
                value: (patch.values[channel] + CURVE_OFFSET).ln(),
                lens: lens.map(|lens| (lens, patch.powers)),
            }));
        }
        all
    }
}

impl PhotoColors {
    fn read(dataset: &Dataset, view: usize) -> Result<PhotoColors> {
        let listed = &dataset.views[view];
        let photo = photo::load(listed)?;
        let patch = |&point: &u32| {
            let position = DVec3::from(dataset.points[point as usize].position);
            let pixel = listed.camera.pixel_from_world(position)?;
            Some(PatchColor {
                point: point as usize,
                values: photo.patch(pixel)?,
                powers: Vignetting::powers(&listed.camera, pixel),
                direction: (listed.camera.position - position).normalize_or_zero(),
            })
        };
        Ok(PhotoColors {
            view,
            lens: lens_size(listed),
            patches: dataset.tracks[view].iter().filter_map(patch).collect(),
        })
    }
}

/// Width and height of a whole photograph; `None` for a side.
pub(super) fn lens_size(view: &View) -> Option<[u32; 2]> {
    (!view.is_side()).then_some([view.camera.width, view.camera.height])
}
