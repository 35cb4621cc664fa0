//! Few views: dropout where few training images show each place.

use super::TrainConfig;
use crate::scene::Dataset;

/// Dropout against overfitting, as the share of the splats left out at the end of the run.
pub(super) const DROP_RATE: f32 = 0.2;

/// Training images of a point, the median over points, up to which dropout acts in full, and from which on it does not
/// act.
const VIEWS: [f64; 2] = [8.0, 12.0];

impl TrainConfig {
    /// The same run for the photographs of a data set: coarse to fine where they are large
    /// ([`coarse_to_fine`](Self::coarse_to_fine)), with dropout where they are few
    /// ([`for_few_views`](Self::for_few_views)).
    pub fn for_dataset(self, dataset: &Dataset) -> TrainConfig {
        self.coarse_to_fine(dataset.mean_pixels())
            .for_few_views(dataset.views_per_point())
    }

    /// The same run where so many training images show a point, the median over points: with dropout if they are few.
    /// Splats otherwise fit each photograph by itself, and views between them suffer.
    pub fn for_few_views(mut self, views_per_point: f64) -> TrainConfig {
        let weight = (VIEWS[1] - views_per_point) / (VIEWS[1] - VIEWS[0]);
        self.drop_rate = DROP_RATE * weight.clamp(0.0, 1.0) as f32;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dropout_fades_as_views_become_many() {
        let of = |views: f64| TrainConfig::for_iterations(1_000).for_few_views(views).drop_rate;
        assert_eq!([0.0, 8.0, 10.0, 12.0, 300.0].map(of), [0.2, 0.2, 0.1, 0.0, 0.0]);
    }
}
