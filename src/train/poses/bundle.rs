//! Bundle adjustment (Triggs 2000), linear: motions of the cameras and of the points that explain the points' places in
//! photographs. Points are eliminated, and conjugate gradients find the motions.

use crate::stats::conjugate_gradients::{self, SymmetricSystem};
use glam::{DMat3, DVec3};

/// Turn about the camera in radians, and shift of its centre in scene extents, both along the world's axes.
pub(super) type Motion = [f64; 6];

/// Windows of a photograph whose errors are independent: those of a rendering are alike all over a picture.
const INDEPENDENT: f64 = 10.0;
/// Fewest observations of a photograph that moves.
pub(super) const OBSERVATIONS_MIN: f64 = 10.0;
/// Weight of the given poses against a motion that all photographs share, times that against a motion of one: the
/// errors of renderings are alike in all photographs, too.
const COMMON: f64 = 10.0;
/// First and least spread of the given poses' errors, radians and scene extents.
pub(super) const SPREAD: [f64; 2] = [0.02, 1e-4];
/// Solutions; each but the last gives the weights of the next.
pub(super) const ROUNDS: usize = 4;
/// Most iterations of conjugate gradients.
const ITERATIONS: usize = 200;
/// Residual at which they end, as a share of the first.
const RESIDUAL: f64 = 1e-5;
/// Error from which an observation counts less, standard deviations (Huber).
pub(super) const ERROR_LARGE: f64 = 2.0;

/// A point seen in a photograph; both rows in standard deviations.
#[derive(Clone, Copy, Debug)]
pub(super) struct PointObservation {
    pub(super) photo: usize,
    /// Derivatives by the camera's motion.
    pub(super) by_motion: [Motion; 2],
    /// Derivatives by the point's place in scene extents.
    pub(super) by_point: [DVec3; 2],
    /// Displacement to explain.
    pub(super) displacement: [f64; 2],
}

impl PointObservation {
    fn moved(&self, motion: &Motion) -> [f64; 2] {
        self.by_motion
            .map(|row| row.iter().zip(motion).map(|(a, b)| a * b).sum())
    }

    /// Displacement that a motion of the camera does not explain.
    pub(super) fn error(&self, motion: &Motion) -> [f64; 2] {
        let moved = self.moved(motion);
        [0, 1].map(|axis| self.displacement[axis] - moved[axis])
    }
}

/// A photograph's pose before the adjustment.
#[derive(Clone, Copy, Debug)]
pub(super) struct PhotoPose {
    /// Rotation from the world to the camera.
    pub(super) rotation: DMat3,
    /// Motion from the given pose so far.
    pub(super) motion: Motion,
}

/// Observations of a point, and their weights.
struct PointTrack<'o> {
    observations: &'o [PointObservation],
    weights: Vec<f64>,
    /// Inverse of Σ weight · Bᵀ B, B the derivatives by the point.
    inverse: DMat3,
}

impl<'o> PointTrack<'o> {
    /// `shares`: weight of the observations of each photograph.
    fn new(observations: &'o [PointObservation], shares: &[f64]) -> PointTrack<'o> {
        let mut track = PointTrack {
            observations,
            weights: observations.iter().map(|seen| shares[seen.photo]).collect(),
            inverse: DMat3::ZERO,
        };
        track.invert();
        track
    }

    fn invert(&mut self) {
        let mut moments = DMat3::ZERO;
        for (observation, weight) in self.weighted() {
            for row in observation.by_point {
                moments += DMat3::from_cols(row * row.x, row * row.y, row * row.z) * weight;
            }
        }
        // The depth of a far point is hardly told.
        let trace = moments.x_axis.x + moments.y_axis.y + moments.z_axis.z;
        self.inverse = (moments + DMat3::from_diagonal(DVec3::splat(1e-9 * trace + f64::MIN_POSITIVE))).inverse();
    }

    fn weighted(&self) -> impl Iterator<Item = (&'o PointObservation, f64)> {
        self.observations.iter().zip(self.weights.iter().copied())
    }

    /// Displacements of the observations, less their part that the best place of the point explains.
    fn without_point(&self, of: impl Fn(&PointObservation) -> [f64; 2]) -> Vec<[f64; 2]> {
        let mut displacements: Vec<[f64; 2]> = self.observations.iter().map(of).collect();
        let mut sum = DVec3::ZERO;
        for ((observation, weight), displacement) in self.weighted().zip(&displacements) {
            for (row, d) in observation.by_point.iter().zip(displacement) {
                sum += *row * (weight * d);
            }
        }
        let point = self.inverse * sum;
        for (observation, displacement) in self.observations.iter().zip(&mut displacements) {
            for (row, d) in observation.by_point.iter().zip(displacement) {
                *d -= row.dot(point);
            }
        }
        displacements
    }
}

/// Normal equations of the motions.
struct NormalEquations<'o> {
    tracks: Vec<PointTrack<'o>>,
    photos: &'o [PhotoPose],
    /// Weight of the observations of each photograph; 0 with too few.
    shares: Vec<f64>,
    /// Information of the given poses: 1 / variance, of turns and of shifts.
    prior: [f64; 2],
}

impl<'o> NormalEquations<'o> {
    fn new(photos: &'o [PhotoPose], points: &'o [Vec<PointObservation>]) -> NormalEquations<'o> {
        let mut counts = vec![0.0; photos.len()];
        points.iter().flatten().for_each(|seen| counts[seen.photo] += 1.0);
        let share = |count: f64| match count >= OBSERVATIONS_MIN {
            true => (INDEPENDENT / count).min(1.0),
            false => 0.0,
        };
        let shares: Vec<f64> = counts.into_iter().map(share).collect();
        let track = |observations: &'o Vec<PointObservation>| PointTrack::new(observations, &shares);
        NormalEquations {
            tracks: points.iter().map(track).collect(),
            photos,
            shares,
            prior: [SPREAD[0].powi(-2); 2],
        }
    }

    /// Whether a photograph has enough observations.
    fn is_used(&self, photo: usize) -> bool {
        self.shares[photo] > 0.0
    }

    fn used_count(&self) -> f64 {
        let used = self.shares.iter().filter(|&&share| share > 0.0);
        (used.count() as f64).max(1.0)
    }

    /// Product with the matrix.
    fn product(&self, motions: &[Motion]) -> Vec<Motion> {
        let mut sums = self.gather(|seen| seen.moved(&motions[seen.photo]));
        self.add_prior(&mut sums, motions, 1.0);
        sums
    }

    /// Right side.
    fn right_side(&self) -> Vec<Motion> {
        let mut sums = self.gather(|seen| seen.displacement);
        let so_far: Vec<Motion> = self.photos.iter().map(|photo| photo.motion).collect();
        self.add_prior(&mut sums, &so_far, -1.0);
        sums
    }

    /// Σ Aᵀ d of each photograph, A the derivatives by its motion and d displacements without the points' part.
    fn gather(&self, of: impl Fn(&PointObservation) -> [f64; 2]) -> Vec<Motion> {
        let mut sums = vec![[0.0; 6]; self.photos.len()];
        for track in &self.tracks {
            let rest = track.without_point(&of);
            for ((seen, weight), displacement) in track.weighted().zip(rest) {
                for (row, d) in seen.by_motion.iter().zip(displacement) {
                    add_row(&mut sums[seen.photo], row, weight * d);
                }
            }
        }
        sums
    }

    /// Adds the prior's product with motions, times a factor.
    fn add_prior(&self, sums: &mut [Motion], motions: &[Motion], factor: f64) {
        let share = (COMMON - 1.0) / self.used_count();
        for (part, information) in self.prior.iter().enumerate() {
            let of = |motion: &Motion| DVec3::from_slice(&motion[3 * part..]);
            let turned = |photo: usize| self.photos[photo].rotation * of(&motions[photo]);
            let used = (0..self.photos.len()).filter(|&photo| self.is_used(photo));
            let common = used.map(turned).sum::<DVec3>() * share;
            for (photo, sum) in sums.iter_mut().enumerate() {
                // The others would move against the common motion.
                let common = if self.is_used(photo) { common } else { DVec3::ZERO };
                let all = of(&motions[photo]) + self.photos[photo].rotation.transpose() * common;
                let terms = sum[3 * part..].iter_mut().zip(all.to_array());
                terms.for_each(|(sum, x)| *sum += factor * information * x);
            }
        }
    }

    /// Inverses of the photographs' own parts of the matrix, points held.
    fn own_inverses(&self) -> Vec<[Motion; 6]> {
        let mut own = vec![diagonal(self.prior); self.photos.len()];
        for (seen, weight) in self.tracks.iter().flat_map(PointTrack::weighted) {
            for row in &seen.by_motion {
                add_outer(&mut own[seen.photo], row, weight);
            }
        }
        own.into_iter().map(inverse).collect()
    }

    fn solve(&self) -> Vec<Motion> {
        let mut motions = vec![[0.0; 6]; self.photos.len()];
        let (matrix, right_side) = (PreconditionedMatrix::of(self), self.right_side().into_flattened());
        let enough = |first: f64| RESIDUAL * RESIDUAL * first;
        let solution = motions.as_flattened_mut();
        conjugate_gradients::improve(&matrix, solution, right_side, enough, ITERATIONS);
        motions
    }

    /// Takes weights from the errors that motions leave, and the prior from the spread of all motions.
    fn reweight(&mut self, motions: &[Motion]) {
        for track in &mut self.tracks {
            let errors = track.without_point(|seen| seen.error(&motions[seen.photo]));
            let seen = track.observations.iter().zip(errors);
            for (weight, (seen, [x, y])) in track.weights.iter_mut().zip(seen) {
                *weight = self.shares[seen.photo] * (ERROR_LARGE / x.hypot(y)).min(1.0);
            }
            track.invert();
        }
        let mut squares = [0.0; 2];
        for (photo, motion) in self.photos.iter().zip(motions) {
            (0..6).for_each(|k| squares[k / 3] += (photo.motion[k] + motion[k]).powi(2));
        }
        let count = 3.0 * self.used_count();
        self.prior = squares.map(|sum| (sum / count + SPREAD[1].powi(2)).recip());
    }
}

/// Matrix of the normal equations, and the inverses of the photographs' own parts.
struct PreconditionedMatrix<'e> {
    equations: &'e NormalEquations<'e>,
    inverses: Vec<[Motion; 6]>,
}

impl<'e> PreconditionedMatrix<'e> {
    fn of(equations: &'e NormalEquations<'e>) -> PreconditionedMatrix<'e> {
        PreconditionedMatrix {
            inverses: equations.own_inverses(),
            equations,
        }
    }
}

impl SymmetricSystem for PreconditionedMatrix<'_> {
    fn product(&self, motions: &[f64]) -> Vec<f64> {
        self.equations.product(motions.as_chunks().0).into_flattened()
    }

    fn precondition(&self, residual: &[f64]) -> Vec<f64> {
        let (rows, _) = residual.as_chunks();
        let scaled = self.inverses.iter().zip(rows).map(|(inverse, row)| times(inverse, row));
        scaled.flatten().collect()
    }
}

/// Motions of photographs that explain the displacements of points, observations of each point together.
///
/// A motion that displacements hardly tell stays near the given poses, whose errors are as large as all motions are.
pub(super) fn adjust(photos: &[PhotoPose], points: &[Vec<PointObservation>]) -> Vec<Motion> {
    let mut equations = NormalEquations::new(photos, points);
    let mut motions = equations.solve();
    for _ in 1..ROUNDS {
        equations.reweight(&motions);
        motions = equations.solve();
    }
    motions
}

/// Diagonal matrix of the information of turns and of shifts.
pub(super) fn diagonal(information: [f64; 2]) -> [Motion; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { information[i / 3] } else { 0.0 }))
}

/// Adds the outer product of a row with itself, times a factor.
pub(super) fn add_outer(sum: &mut [Motion; 6], row: &Motion, factor: f64) {
    let lines = sum.iter_mut().zip(row);
    lines.for_each(|(line, a)| add_row(line, row, factor * a));
}

pub(super) fn add_row(sum: &mut Motion, row: &Motion, factor: f64) {
    let terms = sum.iter_mut().zip(row);
    terms.for_each(|(sum, x)| *sum += factor * x);
}

pub(super) fn times(matrix: &[Motion; 6], vector: &Motion) -> Motion {
    matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
}

/// Inverse of a positive definite matrix, by elimination.
pub(super) fn inverse(mut m: [Motion; 6]) -> [Motion; 6] {
    let mut inverse: [Motion; 6] = diagonal([1.0; 2]);
    for i in 0..6 {
        let pivot = m[i][i].recip();
        for row in [&mut m[i], &mut inverse[i]] {
            *row = row.map(|x| x * pivot);
        }
        let (line, inverse_line) = (m[i], inverse[i]);
        for j in (0..6).filter(|&j| j != i) {
            let factor = -m[j][i];
            add_row(&mut m[j], &line, factor);
            add_row(&mut inverse[j], &inverse_line, factor);
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;
    use crate::train::poses::tracks::derivatives;
    use crate::train::test_camera;
    use glam::DQuat;

    const EXTENT: f64 = 5.0;

    fn noise(i: usize) -> f64 {
        (7.7 * i as f64 + 1.3).sin()
    }

    /// Cameras around points.
    fn cameras() -> Vec<Camera> {
        let camera = |i: u32| {
            let at = DQuat::from_rotation_y(0.7 * f64::from(i)) * DVec3::new(0.0, -1.5, -EXTENT);
            test_camera(640, 480, 600.0).look_at(at, DVec3::ZERO, DVec3::NEG_Y)
        };
        (0..9).map(camera).collect()
    }

    fn photos() -> Vec<PhotoPose> {
        let photo = |camera: &Camera| PhotoPose {
            rotation: camera.rotation,
            motion: [0.0; 6],
        };
        cameras().iter().map(photo).collect()
    }

    /// Points, as cameras with such errors see them; a standard deviation is a tenth of a pixel.
    fn points(errors: &[Motion]) -> Vec<Vec<PointObservation>> {
        let observation = |point: DVec3, photo: usize, camera: &Camera| {
            let (by_motion, by_point) = derivatives(camera, EXTENT, point);
            let mut seen = PointObservation {
                photo,
                by_motion: by_motion.map(|row| row.map(|x| 10.0 * x)),
                by_point: by_point.map(|row| 10.0 * row),
                displacement: [0.0; 2],
            };
            seen.displacement = seen.moved(&errors[photo].map(|x| -x));
            seen
        };
        let point = |i: usize| {
            let place = DVec3::new(noise(5 * i), 0.4 * noise(5 * i + 1), noise(5 * i + 2));
            let photos = cameras().into_iter().enumerate();
            photos
                .map(|(photo, camera)| observation(place, photo, &camera))
                .collect()
        };
        (0..60).map(point).collect()
    }

    fn errors() -> Vec<Motion> {
        (0..9)
            .map(|photo| std::array::from_fn(|k| 0.01 * noise(6 * photo + k)))
            .collect()
    }

    /// Displacements that motions leave and no place of a point explains, root mean square.
    fn left(points: &[Vec<PointObservation>], motions: &[Motion]) -> f64 {
        let errors = points.iter().flat_map(|point| {
            PointTrack::new(point, &[1.0; 9]).without_point(|seen| {
                let moved = seen.moved(&motions[seen.photo]);
                [0, 1].map(|axis| seen.displacement[axis] - moved[axis])
            })
        });
        let errors: Vec<[f64; 2]> = errors.collect();
        let squares: f64 = errors.as_flattened().iter().map(|x| x * x).sum();
        (squares / errors.len() as f64).sqrt()
    }

    #[test]
    fn motions_explain_where_points_are_seen() {
        let points = points(&errors());
        let before = left(&points, &[[0.0; 6]; 9]);
        let after = left(&points, &adjust(&photos(), &points));
        assert!(before > 20.0 && after < 0.5, "{before} before, {after} after");
    }

    #[test]
    fn wrong_matches_count_little() {
        let clean = points(&errors());
        let mut wrong = clean.clone();
        wrong
            .iter_mut()
            .step_by(8)
            .for_each(|point| point[3].displacement[0] += 500.0);
        let [exact, found] = [&clean, &wrong].map(|points| left(&clean, &adjust(&photos(), points)));
        assert!(found < exact + 2.0, "{found}, {exact} without wrong matches");
    }

    #[test]
    fn exact_poses_and_photographs_without_points_stay() {
        assert_eq!(adjust(&photos(), &points(&[[0.0; 6]; 9])), [[0.0; 6]; 9]);
        let mut points = points(&errors());
        points.iter_mut().for_each(|point| point.truncate(8));
        let motions = adjust(&photos(), &points);
        assert!(motions[8] == [0.0; 6] && motions[7] != [0.0; 6], "{motions:?}");
        assert_eq!(adjust(&photos(), &[]), [[0.0; 6]; 9]);
    }
}
