//! Models placed in a picture together: each by a similarity transform, with opacity, tint and a box that clips it.
//!
//! The camera is moved into each model in place of the model into the world: with x = s R m + t, view coordinates are
//! (V s R) (m − p′) of the camera centre p′ in the model. Harmonics are then taken at directions of the model,
//! unrotated; depths, near plane and order are those of the world.

use super::model::Model;
use crate::gpu::PART_ALIGNMENT;
use crate::kernels::project::Params;
use crate::layout::{INSTANCE_COMPENSATE, INSTANCE_CUT, INSTANCE_KEEP};
use crate::scene::{Camera, NotFinite, Primitive, ScreenFilter, Similarity};
use crate::{Error, Result};
use glam::{DAffine3, DMat4, DVec3};

/// A model in a picture.
#[derive(Clone, Copy, Debug)]
pub struct Instance<'a> {
    /// The model.
    pub model: &'a Model,
    /// Place of the model in the world.
    pub world_from_model: Similarity,
    /// Factor of the opacities, 0 to 1.
    pub opacity: f32,
    /// Factors of red, green and blue, from 0 on.
    pub tint: [f32; 3],
    /// Box that clips the splats.
    pub clip: Option<ClipBox>,
    /// Filter on the screen, that of the model's training.
    pub filter: ScreenFilter,
}

/// A box in the world that clips splats by their means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipBox {
    /// Place of the cube from −1 to 1 in the world: the box.
    pub world_from_cube: DMat4,
    /// True if splats inside are left out; else those outside.
    pub cuts_inside: bool,
}

impl<'a> Instance<'a> {
    /// A model where it is, as it is.
    pub fn new(model: &'a Model) -> Instance<'a> {
        Instance {
            model,
            world_from_model: Similarity::IDENTITY,
            opacity: 1.0,
            tint: [1.0; 3],
            clip: None,
            filter: model.filter,
        }
    }

    /// Checks transform, opacity, tint and box.
    fn check(&self) -> Result<()> {
        if self.model.primitive != Primitive::Gaussian3d {
            let kind = self.model.primitive.name();
            return Err(Error::Config(format!(
                "a model of the kind {kind}: instances are 3D Gaussians"
            )));
        }
        self.world_from_model.check()?;
        let opacity = self.opacity;
        if !(0.0..=1.0).contains(&opacity) {
            return Err(Error::Config(format!("an opacity of {opacity}: 0 to 1")));
        }
        if !self.tint.iter().all(|factor| factor.is_finite() && *factor >= 0.0) {
            let what = format!("a tint of {:?}: numbers from 0 on", self.tint);
            return Err(Error::Config(what));
        }
        match &self.clip {
            Some(clip) if !self.cube_from_model(clip).is_finite() => {
                Err(Error::Config("a clip box that is not finite, or flat".into()))
            }
            _ => Ok(()),
        }
    }

    fn cube_from_model(&self, clip: &ClipBox) -> DAffine3 {
        DAffine3::from_mat4(clip.world_from_cube.inverse() * self.world_from_model.matrix())
    }

    /// The kernel's parameters, but for those of the block.
    fn params(&self, camera: &Camera) -> Params {
        let place = &self.world_from_model;
        let clip = self
            .clip
            .as_ref()
            .map(|clip| (self.cube_from_model(clip), clip.cuts_inside));
        let clips = match clip {
            None => 0,
            Some((_, false)) => INSTANCE_KEEP,
            Some((_, true)) => INSTANCE_CUT,
        };
        let compensates = match self.filter.keeps_light() {
            true => INSTANCE_COMPENSATE,
            false => 0,
        };
        let cube = clip.map_or(DAffine3::IDENTITY, |(cube, _)| cube);
        let view_from_model = (camera.rotation * place.rotation) * place.scale;
        Params {
            view_from_model: view_from_model.as_mat3().to_cols_array_2d(),
            position: place.point_before(camera.position).as_vec3().to_array(),
            cube_from_model: cube.matrix3.as_mat3().to_cols_array_2d(),
            cube_origin: cube.translation.as_vec3().to_array(),
            tint: self.tint,
            log_opacity: self.opacity.log2(),
            dilation: self.filter.dilation() as f32,
            flags: clips | compensates,
            ..Params::default()
        }
    }
}

/// Splats of a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) enum FrameContent<'a> {
    /// One model in the world of the view.
    Model(&'a Model),
    /// Models in their places, and the camera of the view.
    Instances(&'a [Instance<'a>], &'a Camera),
}

impl<'a> From<&'a Model> for FrameContent<'a> {
    fn from(model: &'a Model) -> FrameContent<'a> {
        FrameContent::Model(model)
    }
}

/// A model's part of a picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Portion<'a> {
    pub(super) model: &'a Model,
    /// Its first element in arrays with one element per splat of the picture.
    pub(super) first: usize,
    /// First element of the next portion: those between belong to no splat.
    pub(super) end: usize,
    /// Parameters of its instance; those of a lone model are not read.
    pub(super) params: Params,
    pub(super) is_instance: bool,
}

impl<'a> FrameContent<'a> {
    /// Models of the picture.
    pub(super) fn models(self) -> impl Iterator<Item = &'a Model> {
        let (one, all): (Option<&Model>, &[Instance<'_>]) = match self {
            FrameContent::Model(model) => (Some(model), &[]),
            FrameContent::Instances(all, _) => (None, all),
        };
        one.into_iter().chain(all.iter().map(|instance| instance.model))
    }

    /// True for instances.
    pub(super) fn has_instances(self) -> bool {
        matches!(self, FrameContent::Instances(..))
    }

    /// Parts of the picture, one for each model.
    pub(super) fn portions(self) -> impl Iterator<Item = Portion<'a>> {
        let (camera, count) = match self {
            FrameContent::Model(_) => (None, 1),
            FrameContent::Instances(all, camera) => (Some((all, camera)), all.len()),
        };
        let mut end = 0;
        self.models().enumerate().map(move |(index, model)| {
            let first = end;
            end += model.splat_count;
            if index + 1 < count {
                end = end.next_multiple_of(PART_ALIGNMENT);
            }
            Portion {
                model,
                first,
                end,
                params: camera.map_or(Params::default(), |(all, camera)| all[index].params(camera)),
                is_instance: camera.is_some(),
            }
        })
    }

    /// Elements of arrays with one element per splat of the picture.
    pub(crate) fn splat_count(self) -> usize {
        let mut end = 0_usize;
        for model in self.models() {
            end = end.next_multiple_of(PART_ALIGNMENT) + model.splat_count;
        }
        end
    }

    /// Splats that are not drawn for a number that is not finite; the first by its index in its model.
    pub(super) fn not_finite(self) -> Option<NotFinite> {
        let found = self.models().filter_map(|model| model.not_finite);
        found.reduce(|first, next| NotFinite {
            count: first.count + next.count,
            ..first
        })
    }

    /// Checks the instances.
    ///
    /// # Errors
    /// [`Error::Config`] with the number of the first faulty one.
    pub(super) fn check(self) -> Result<()> {
        let FrameContent::Instances(all, _) = self else {
            return Ok(());
        };
        for (index, instance) in all.iter().enumerate() {
            if let Err(error) = instance.check() {
                return Err(Error::Config(format!("instance {index}: {error}")));
            }
        }
        Ok(())
    }
}

impl ClipBox {
    /// Box with sides along the axes of the world, between two corners, with the splats inside kept.
    pub fn between(low: DVec3, high: DVec3) -> ClipBox {
        ClipBox {
            world_from_cube: DMat4::from_translation((low + high) / 2.0) * DMat4::from_scale((high - low) / 2.0),
            cuts_inside: false,
        }
    }
}
