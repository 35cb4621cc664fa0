//! Few views: measures against overfitting where few training images show each place.

use super::TrainConfig;
use crate::scene::Dataset;

/// Dropout against overfitting, as the share of the splats left out at the end of the run.
pub(super) const DROP_RATE: f32 = 0.2;

/// Weight of MCMC's penalties beside it: without them dropout gains less SSIM on most scenes, in full they cost
/// decibels on some.
const REGULARIZATION: f32 = 0.3;

/// Training images of a point, the median over points, up to which the measures act in full, and from which on they do
/// not act.
const VIEWS: [f64; 2] = [8.0, 12.0];

impl TrainConfig {
    /// The same run for the photographs of a data set: coarse to fine where they are large
    /// ([`coarse_to_fine`](Self::coarse_to_fine)), against overfitting where they are few
    /// ([`for_few_views`](Self::for_few_views)).
    pub fn for_dataset(self, dataset: &Dataset) -> TrainConfig {
        self.coarse_to_fine(dataset.mean_pixels())
            .for_few_views(dataset.views_per_point())
    }

    /// The same run where so many training images show a point, the median over points: if they are few, with dropout
    /// and weak penalties of opacity and scale. Splats otherwise fit each photograph by itself, and views between them
    /// suffer.
    pub fn for_few_views(mut self, views_per_point: f64) -> TrainConfig {
        let weight = ((VIEWS[1] - views_per_point) / (VIEWS[1] - VIEWS[0])).clamp(0.0, 1.0) as f32;
        self.drop_rate = DROP_RATE * weight;
        self.regularization = REGULARIZATION * weight;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measures_fade_as_views_become_many() {
        let of = |views: f64| {
            let config = TrainConfig::for_iterations(1_000).for_few_views(views);
            assert!(config.validate().is_ok());
            [config.drop_rate, config.regularization]
        };
        let [none, half, full] = [[0.0; 2], [0.1, 0.15], [0.2, 0.3]];
        assert_eq!([0.0, 8.0, 10.0, 12.0, 300.0].map(of), [full, full, half, none, none]);
    }
}
