//! Pose of one photograph to a scene that is held (resection).

use super::bundle::{ERROR_LARGE, Motion, OBSERVATIONS_MIN, PointObservation, ROUNDS, SPREAD};
use super::bundle::{add_outer, add_row, diagonal, inverse, times};

/// Motion of a camera that explains the displacements of points, which stay in their places; `None` with too few.
pub(super) fn motion(observations: &[PointObservation]) -> Option<Motion> {
    if (observations.len() as f64) < OBSERVATIONS_MIN {
        return None;
    }
    let mut motion = [0.0; 6];
    for _ in 0..ROUNDS {
        let (mut matrix, mut right) = (diagonal([SPREAD[0].powi(-2); 2]), [0.0; 6]);
        for seen in observations {
            let [x, y] = seen.error(&motion);
            let weight = (ERROR_LARGE / x.hypot(y)).min(1.0);
            for (row, d) in seen.by_motion.iter().zip(seen.displacement) {
                add_outer(&mut matrix, row, weight);
                add_row(&mut right, row, weight * d);
            }
        }
        motion = times(&inverse(matrix), &right);
    }
    Some(motion)
}

#[cfg(test)]
mod tests {
    use super::super::tracks::derivatives;
    use super::*;
    use crate::train::test_camera;
    use glam::DVec3;

    /// Observations of points in a box, displaced by a motion of the camera; the first few are wrong.
    fn observations(wanted: Motion, wrong: usize) -> Vec<PointObservation> {
        let camera = test_camera(160, 120, 170.0).look_at(DVec3::new(1.0, -2.0, -4.0), DVec3::ZERO, DVec3::NEG_Y);
        let point = |i: usize| DVec3::new((i % 5) as f64, (i / 5 % 5) as f64, (i / 25) as f64) * 0.3 - 0.6;
        let observe = |i: usize| {
            let (by_motion, by_point) = derivatives(&camera, 5.0, point(i));
            let mut seen = PointObservation {
                photo: 0,
                by_motion: by_motion.map(|row| row.map(|x| 10.0 * x)),
                by_point,
                displacement: [if i < wrong { -30.0 } else { 0.0 }; 2],
            };
            seen.displacement = seen.error(&wanted).map(|error| -error);
            seen
        };
        (0..75).map(observe).collect()
    }

    #[test]
    fn small_motions_are_found_among_outliers() {
        let wanted = [2e-4, -1e-4, 3e-4, 1e-4, 2e-4, -2e-4];
        // Errors of 42 standard deviations at one point of fifteen have a mean of 2.8.
        for (wrong, tolerance) in [(0, 0.01), (5, 1.0)] {
            let seen = observations(wanted, wrong);
            let found = motion(&seen).unwrap();
            for right in &seen[wrong..] {
                let [x, y] = right.error(&found);
                assert!(x.hypot(y) < tolerance, "{wrong}: {x}, {y} standard deviations");
            }
        }
        assert_eq!(motion(&observations(wanted, 0)[..9]), None);
    }
}
