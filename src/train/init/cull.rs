//! Culling of a data set's points: those seen by too few views, and outliers. Such points are mostly wrong matches, and
//! become floaters.

use crate::scene::{Camera, Point};
use crate::train::config::InitConfig;
use glam::DVec3;
use rayon::prelude::*;

/// The finite points within the configured limits, in their order.
pub(super) fn culled(points: &[Point], cameras: &[Camera], config: &InitConfig) -> Vec<Point> {
    // At most the number of cameras.
    let wanted = (config.cull_views as usize).min(cameras.len());
    let fence = Fence::around(points, f64::from(config.cull_fence));
    let is_kept = |point: &&Point| {
        let position = DVec3::from(point.position);
        let views = cameras.iter().filter(|camera| camera.sees(position));
        fence.holds(position) && views.take(wanted).count() == wanted
    };
    points.par_iter().filter(is_kept).copied().collect()
}

/// A box independent of outliers while they are fewer than a quarter of the points.
struct Fence {
    low: DVec3,
    high: DVec3,
}

impl Fence {
    /// Box from the quartiles of each coordinate, extended by `factor` times their distance; unbounded if `factor` is
    /// 0.
    fn around(points: &[Point], factor: f64) -> Fence {
        let everything = Fence {
            low: DVec3::NEG_INFINITY,
            high: DVec3::INFINITY,
        };
        if factor <= 0.0 || points.is_empty() {
            return everything;
        }
        let mut fence = everything;
        for axis in 0..3 {
            let mut sorted: Vec<f64> = points.iter().map(|p| p.position[axis]).collect();
            sorted.sort_unstable_by(f64::total_cmp);
            let at = |quarter: usize| sorted[(sorted.len() - 1) * quarter / 4];
            let reach = factor * (at(3) - at(1));
            fence.low[axis] = at(1) - reach;
            fence.high[axis] = at(3) + reach;
        }
        fence
    }

    fn holds(&self, position: DVec3) -> bool {
        position.cmpge(self.low).all() && position.cmple(self.high).all()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::test_camera;

    fn points(positions: impl IntoIterator<Item = [f64; 3]>) -> Vec<Point> {
        let point = |position| Point {
            position,
            color: [0.5; 3],
        };
        positions.into_iter().map(point).collect()
    }

    fn config(cull_views: u32, cull_fence: f32) -> InitConfig {
        InitConfig {
            cull_views,
            cull_fence,
            ..InitConfig::default()
        }
    }

    /// Camera at x along z, with a half field of view of 45°.
    fn camera(x: f64) -> Camera {
        Camera {
            position: DVec3::new(x, 0.0, 0.0),
            ..test_camera(100, 100, 50.0)
        }
    }

    #[test]
    fn points_that_too_few_views_see_are_left_out() {
        let cameras = [camera(0.0), camera(3.0)];
        // Between them near and far, in front of one only, behind both.
        let all = points([[1.5, 0.0, 1.0], [1.5, 0.0, 9.0], [0.0, 0.0, 1.0], [1.5, 0.0, -9.0]]);
        let left = |views| culled(&all, &cameras, &config(views, 0.0)).len();
        assert_eq!([left(0), left(1), left(2), left(3)], [4, 2, 1, 1]);
    }

    #[test]
    fn points_far_from_the_bulk_are_left_out_wherever_it_lies() {
        let bulk = (0..101).map(|i| [1e3 + f64::from(i) * 0.01, f64::from(i), 0.0]);
        // The quartiles of y are about 25 and 75: the fence runs from about -125 to 225.
        let strays = [200.0, 250.0, -100.0, -150.0].map(|y| [1e3, y, 0.0]);
        let strays = strays.into_iter().chain([[0.0; 3]]);
        let all = points(bulk.chain(strays));
        let kept = culled(&all, &[], &config(2, 3.0));
        assert_eq!(kept.len(), 103);
        assert_eq!(culled(&all, &[], &config(2, 0.0)).len(), 106);
        assert!(culled(&[], &[], &config(2, 3.0)).is_empty());
    }
}
