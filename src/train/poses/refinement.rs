//! Refined poses of a run.

use super::bundle::{Motion, PhotoPose};
use crate::scene::{Camera, Dataset, PoseDifference, Similarity};
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Refined poses, by photograph: in the order of the first training view of each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseState {
    /// Turn of the world about the camera, a unit quaternion x, y, z, w: the rotation is the given one times this.
    pub turn: Vec<[f64; 4]>,
    /// Shift of the centre, world units.
    pub shift: Vec<[f64; 3]>,
}

impl PoseState {
    /// The given poses of so many photographs.
    fn given(photos: usize) -> PoseState {
        PoseState {
            turn: vec![DQuat::IDENTITY.to_array(); photos],
            shift: vec![[0.0; 3]; photos],
        }
    }

    /// Whether all parts have the same number of photographs, and finite numbers.
    pub fn is_whole(&self) -> bool {
        let numbers = [self.turn.as_flattened(), self.shift.as_flattened()];
        self.turn.len() == self.shift.len() && numbers.iter().all(|part| part.iter().all(|x| x.is_finite()))
    }
}

/// Refined poses of the training views.
#[derive(Clone, Debug)]
pub struct RefinedPoses {
    /// Given cameras of the training views.
    given: Vec<Camera>,
    /// Photograph of each training view: sides of one photograph move together.
    photo_from_view: Vec<usize>,
    /// First training view of each photograph.
    first_view: Vec<usize>,
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
        Some(RefinedPoses {
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

    /// Pose of each photograph, with its motion from the given one.
    pub(super) fn photos(&self) -> Vec<PhotoPose> {
        let states = self.state.turn.iter().zip(&self.state.shift);
        let photos = self.first_view.iter().zip(states);
        let pose = |(&place, (turn, shift)): (&usize, (&[f64; 4], &[f64; 3]))| {
            let turn = DQuat::from_array(*turn);
            let [x, y, z] = turn.to_scaled_axis().to_array();
            let [along_x, along_y, along_z] = shift.map(|length| length / self.extent);
            PhotoPose {
                rotation: self.given[place].rotation * DMat3::from_quat(turn),
                motion: [x, y, z, along_x, along_y, along_z],
            }
        };
        photos.map(pose).collect()
    }

    /// Photograph of the training view at `place`.
    pub(super) fn photo(&self, place: usize) -> usize {
        self.photo_from_view[place]
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

    /// Moves all poses, and takes the gauge out.
    pub(super) fn apply(&mut self, motions: &[Motion]) {
        let states = self.state.turn.iter_mut().zip(&mut self.state.shift);
        for ((turn, shift), [x, y, z, moved @ ..]) in states.zip(motions) {
            let turned = DQuat::from_array(*turn) * DQuat::from_scaled_axis(DVec3::new(*x, *y, *z));
            *turn = turned.normalize().to_array();
            *shift = (DVec3::from(*shift) + self.extent * DVec3::from(*moved)).to_array();
        }
        self.align();
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
