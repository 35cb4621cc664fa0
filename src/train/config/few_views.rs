//! Few views: dropout and smooth surfaces where few training images show each place.

use super::TrainConfig;
use crate::scene::Dataset;

/// Dropout against overfitting, as the share of the splats left out at the end of the run.
pub(super) const DROP_RATE: f32 = 0.2;

/// Weight of the consistency of normals against overfitting.
pub(super) const NORMAL_WEIGHT: f32 = 0.2;

/// Training images of a point, the median over points, up to which dropout acts in full, and from which on it does not
/// act.
const DROPOUT_VIEWS: [f64; 2] = [8.0, 12.0];

/// The same of the consistency of normals.
const NORMAL_VIEWS: [f64; 2] = [8.0, 24.0];

impl TrainConfig {
    /// The same run for the photographs of a data set: coarse to fine where they are large
    /// ([`coarse_to_fine`](Self::coarse_to_fine)), with dropout and consistent normals where they are few
    /// ([`for_few_views`](Self::for_few_views)).
    pub fn for_dataset(self, dataset: &Dataset) -> TrainConfig {
        self.coarse_to_fine(dataset.mean_pixels())
            .for_few_views(dataset.views_per_point())
    }

    /// The same run where so many training images show a point, the median over points: with dropout and consistent
    /// normals if they are few. Splats otherwise fit each photograph by itself, and views between them suffer.
    pub fn for_few_views(mut self, views_per_point: f64) -> TrainConfig {
        let share = |[full, none]: [f64; 2]| ((none - views_per_point) / (none - full)).clamp(0.0, 1.0) as f32;
        self.drop_rate = DROP_RATE * share(DROPOUT_VIEWS);
        self.geometry.normal = self.geometry.normal.max(NORMAL_WEIGHT * share(NORMAL_VIEWS));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Primitive;

    #[test]
    fn measures_fade_as_views_become_many() {
        let of = |views: f64| TrainConfig::for_iterations(1_000).for_few_views(views);
        let views = [0.0, 8.0, 10.0, 12.0, 16.0, 24.0, 300.0];
        assert_eq!(views.map(|v| of(v).drop_rate), [0.2, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(
            views.map(|v| of(v).geometry.normal),
            [0.2, 0.2, 0.175, 0.15, 0.1, 0.0, 0.0]
        );
    }

    #[test]
    fn surfels_keep_their_normals() {
        let surfels = TrainConfig::for_iterations(1_000).with_kind(Primitive::Surfel);
        let normal = surfels.geometry.normal;
        assert!(normal > 0.0);
        assert_eq!(surfels.for_few_views(300.0).geometry.normal, normal);
    }
}
