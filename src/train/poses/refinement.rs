//! Refined poses of a run, and their steps.

use super::modes::{Motion, MotionModes};
use crate::scene::{Camera, Dataset, PoseDifference, Similarity};
use crate::train::config::PoseConfig;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Refined poses between two steps, by photograph: in the order of the first training view of each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseState {
    /// Turn of the world about the camera, a unit quaternion x, y, z, w: the rotation is the given one times this.
    pub turn: Vec<[f64; 4]>,
    /// Shift of the centre, world units.
    pub shift: Vec<[f64; 3]>,
    /// Force on all splats and their torque about the camera, world axes, summed since the last update.
    pub sums: Vec<[[f64; 3]; 2]>,
    /// First and second moments along the axes of motion.
    pub moments: Vec<[Motion; 2]>,
    /// Updates so far of each photograph.
    pub updates: Vec<u32>,
}

impl PoseState {
    /// The given poses of so many photographs.
    fn given(photos: usize) -> PoseState {
        PoseState {
            turn: vec![DQuat::IDENTITY.to_array(); photos],
            shift: vec![[0.0; 3]; photos],
            sums: vec![[[0.0; 3]; 2]; photos],
            moments: vec![[[0.0; 6]; 2]; photos],
            updates: vec![0; photos],
        }
    }

    /// Whether all parts have the same number of photographs, and finite numbers.
    pub fn is_whole(&self) -> bool {
        let count = self.turn.len();
        let counts = [
            self.shift.len(),
            self.sums.len(),
            self.moments.len(),
            self.updates.len(),
        ];
        let numbers = [
            self.turn.as_flattened(),
            self.shift.as_flattened(),
            self.sums.as_flattened().as_flattened(),
            self.moments.as_flattened().as_flattened(),
        ];
        counts.iter().all(|&c| c == count) && numbers.iter().all(|part| part.iter().all(|x| x.is_finite()))
    }
}

/// Rounds of both parts of the gauge, which disturb each other little.
const GAUGE_ROUNDS: usize = 3;

/// Refined poses of the training views.
#[derive(Clone, Debug)]
pub struct RefinedPoses {
    /// Given cameras of the training views.
    given: Vec<Camera>,
    /// Photograph of each training view: sides of one photograph move together.
    photo_from_view: Vec<usize>,
    /// First training view of each photograph; turns and shifts follow the axes of its camera.
    first_view: Vec<usize>,
    modes: Vec<MotionModes>,
    extent: f64,
    state: PoseState,
}

/// Name of the photograph of a view: sides are named NAME#side.
pub fn photo_name(view: &str) -> &str {
    view.rsplit_once('#').map_or(view, |(photo, _)| photo)
}

impl RefinedPoses {
    /// Poses of the training views `views`, as given or as a state has them; `None` if the state has another number of
    /// photographs.
    pub fn new(dataset: &Dataset, views: &[usize], extent: f64, saved: Option<PoseState>) -> Option<RefinedPoses> {
        let given: Vec<Camera> = views.iter().map(|&view| dataset.views[view].camera).collect();
        let (mut photos, mut first_view, mut photo_from_view) = (BTreeMap::new(), Vec::new(), Vec::new());
        for (place, &view) in views.iter().enumerate() {
            let photo = *photos.entry(photo_name(&dataset.views[view].name)).or_insert_with(|| {
                first_view.push(place);
                first_view.len() - 1
            });
            photo_from_view.push(photo);
        }
        let state = saved.unwrap_or_else(|| PoseState::given(first_view.len()));
        if state.turn.len() != first_view.len() || !state.is_whole() {
            return None;
        }
        let step = dataset.points.len().div_ceil(20_000).max(1);
        let points = || {
            dataset
                .points
                .iter()
                .step_by(step)
                .map(|point| DVec3::from(point.position))
        };
        let modes = first_view
            .iter()
            .map(|&view| MotionModes::of(&given[view], extent, points()));
        Some(RefinedPoses {
            modes: modes.collect(),
            given,
            photo_from_view,
            first_view,
            extent,
            state,
        })
    }

    /// State for a checkpoint.
    pub fn state(&self) -> &PoseState {
        &self.state
    }

    /// A camera of the training view at `place`, of any size, in its refined pose.
    pub fn refined(&self, place: usize, camera: &Camera) -> Camera {
        let photo = self.photo_from_view[place];
        Camera {
            rotation: camera.rotation * DMat3::from_quat(DQuat::from_array(self.state.turn[photo])),
            position: camera.position + DVec3::from(self.state.shift[photo]),
            ..*camera
        }
    }

    /// Turn (radians, world axes) and shift (world units) of each training view's pose.
    pub fn motion(&self, place: usize) -> (DQuat, DVec3) {
        let photo = self.photo_from_view[place];
        let turn = DQuat::from_array(self.state.turn[photo]);
        (turn, self.state.shift[photo].into())
    }

    /// Difference of each training view's pose from the given one.
    pub fn differences(&self) -> Vec<PoseDifference> {
        let places = self.given.iter().enumerate();
        places
            .map(|(place, given)| PoseDifference::of(given, &self.refined(place, given)))
            .collect()
    }

    /// Adds the sums of a step, by workgroup: force, then torque.
    pub(crate) fn add(&mut self, place: usize, partials: &[[f32; 4]]) {
        let sums = &mut self.state.sums[self.photo_from_view[place]];
        for pair in partials.chunks_exact(2) {
            for (sum, part) in sums.iter_mut().zip(pair) {
                let lanes = sum.iter_mut().zip(part);
                lanes.for_each(|(sum, x)| *sum += f64::from(*x));
            }
        }
    }

    /// Moves all poses by a step at a share of the first rates, and forgets the sums. `visits`: epochs with an update
    /// in the whole run. A photograph without a gradient stays.
    pub(crate) fn update(&mut self, config: &PoseConfig, rate: f64, visits: u32) {
        let rates = config.rates(visits).map(|first| first * rate);
        for photo in 0..self.first_view.len() {
            self.update_photo(photo, config, rates);
        }
        self.fix_gauge();
    }

    /// Forgets the sums.
    pub(crate) fn forget(&mut self) {
        self.state.sums.fill([[0.0; 3]; 2]);
    }

    fn update_photo(&mut self, photo: usize, config: &PoseConfig, [pixels, radians]: [f64; 2]) {
        let [force, torque] = std::mem::take(&mut self.state.sums[photo]).map(DVec3::from);
        let rotation = self.given[self.first_view[photo]].rotation;
        // A camera that moves is all splats moving the other way.
        let (turn, shift) = (rotation * torque, -self.extent * (rotation * force));
        let slope = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z];
        let modes = &self.modes[photo];
        let slope = modes.along(&slope);
        let largest = slope.iter().fold(0.0_f64, |most, s| most.max(s.abs()));
        if !(largest.is_finite() && slope.iter().all(|s| s.is_finite()) && largest > 0.0) {
            return;
        }
        let [first, second] = &mut self.state.moments[photo];
        self.state.updates[photo] += 1;
        let betas = [config.beta1, config.beta2].map(f64::from);
        let corrections = betas.map(|beta| 1.0 - beta.powf(f64::from(self.state.updates[photo])));
        let mut step = [0.0; 6];
        for k in 0..6 {
            first[k] += (1.0 - betas[0]) * (slope[k] - first[k]);
            second[k] += (1.0 - betas[1]) * (slope[k] * slope[k] - second[k]);
            let along = first[k] / corrections[0] / ((second[k] / corrections[1]).sqrt() + f64::MIN_POSITIVE);
            // Its square: slopes that keep their sign move a pose, others hardly do.
            let along = along * along.abs();
            // The smaller of so many pixels and so many radians, softly.
            let reach = (modes.pixels[k] / pixels).hypot(1.0 / radians).recip();
            step[k] = -reach * along;
        }
        let [x, y, z, right, down, ahead] = modes.motion(&step);
        let turn = DQuat::from_scaled_axis(rotation.transpose() * DVec3::new(x, y, z));
        let shift = rotation.transpose() * (self.extent * DVec3::new(right, down, ahead));
        self.state.turn[photo] = (DQuat::from_array(self.state.turn[photo]) * turn)
            .normalize()
            .to_array();
        self.state.shift[photo] = (DVec3::from(self.state.shift[photo]) + shift).to_array();
    }

    /// Takes out the motion that all photographs have in common, in the axes of the cameras, and the similarity of all
    /// refined poses to the given ones.
    fn fix_gauge(&mut self) {
        for _ in 0..GAUGE_ROUNDS {
            self.center();
            self.align();
        }
    }

    /// Takes out the mean turn and the mean shift in the axes of the cameras. Pictures that all move down are nearly
    /// those of a scene that moves up: this drift would end with the scene in another place, and it begins while the
    /// splats do not show the scene yet.
    fn center(&mut self) {
        let axes = |photo: usize| self.given[self.first_view[photo]].rotation;
        let count = self.first_view.len();
        let turn = |photo: usize| axes(photo) * DQuat::from_array(self.state.turn[photo]).to_scaled_axis();
        let shift = |photo: usize| axes(photo) * DVec3::from(self.state.shift[photo]);
        let share = 1.0 / count.max(1) as f64;
        let mean_turn = (0..count).map(turn).sum::<DVec3>() * share;
        let mean_shift = (0..count).map(shift).sum::<DVec3>() * share;
        for photo in 0..count {
            let back = self.given[self.first_view[photo]].rotation.transpose();
            let turn = DQuat::from_scaled_axis(back * -mean_turn) * DQuat::from_array(self.state.turn[photo]);
            self.state.turn[photo] = turn.normalize().to_array();
            self.state.shift[photo] = (DVec3::from(self.state.shift[photo]) - back * mean_shift).to_array();
        }
    }

    /// Takes out the similarity of all refined poses to the given ones.
    fn align(&mut self) {
        let places = self.given.iter().enumerate();
        let refined: Vec<Camera> = places.map(|(place, given)| self.refined(place, given)).collect();
        let back = Similarity::between(&self.given, &refined).inverse();
        for (photo, &place) in self.first_view.iter().enumerate() {
            let (given, moved) = (&self.given[place], back.moved(&refined[place]));
            let turn = DQuat::from_mat3(&(given.rotation.transpose() * moved.rotation));
            self.state.turn[photo] = turn.normalize().to_array();
            self.state.shift[photo] = (moved.position - given.position).to_array();
        }
    }
}
