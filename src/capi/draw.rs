//! Pictures of C converted: images, camera, instances.

use super::failure::Failure;
use super::memory::{array, optional, read};
use super::picture::{
    ASHFALL_BLEND_OVER_DISPLAY, ASHFALL_BLEND_OVER_LINEAR, ASHFALL_BLEND_PREMULTIPLIED, ASHFALL_BLEND_REPLACE,
    AshfallDepth, AshfallDraw, AshfallImage, AshfallInstance, AshfallPickArea, AshfallState,
};
use super::projection::camera_of;
use super::registry::find;
use crate::gpu::ash::vk::{Image as VkImage, ImageLayout as VkImageLayout, ImageView as VkImageView};
use crate::gpu::{HostImage, HostImageDesc, ImageState};
use crate::render::{
    Blend, ClipBox, DepthCode, DepthKind, HostDepth, HostTarget, Instance, Model, PickArea, ViewOptions,
};
use crate::scene::{Camera, Similarity};
use glam::{DMat4, DVec4};
use std::sync::Arc;

/// Place and looks of an instance, without its model.
#[derive(Clone, Copy, Debug)]
struct Looks {
    world_from_model: Similarity,
    opacity: f32,
    tint: [f32; 3],
    clip: Option<ClipBox>,
}

/// Instances and camera of a picture.
#[derive(Debug)]
pub(super) struct Shot {
    models: Vec<(Arc<Model>, Looks)>,
    pub(super) camera: Camera,
}

/// Images of a picture, and the blending with them.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) color: HostImage,
    depth: Option<(HostImage, DepthCode)>,
    blend: Blend,
    ids: Option<HostImage>,
    depth_out: Option<(HostImage, DepthCode)>,
    depth_kind: DepthKind,
    pick: Option<PickArea>,
    origin: Option<[u32; 2]>,
    pub(super) options: ViewOptions,
}

impl Shot {
    /// Models and camera of a picture.
    ///
    /// # Safety
    /// The pointers are null or valid for their counts and sizes.
    pub(super) unsafe fn of(draw: &AshfallDraw) -> Result<Shot, Failure> {
        // SAFETY: as the caller says.
        let (camera, instances) = unsafe { (read(draw.camera)?, array(draw.instances, draw.instance_count)?) };
        let mut models = Vec::with_capacity(instances.len());
        for (index, instance) in instances.iter().enumerate() {
            let named = |failure: Failure| Failure::argument(format!("instance {index}: {}", failure.message));
            // SAFETY: as the caller says.
            let looks = unsafe { looks(instance) };
            models.push((find(instance.model).map_err(named)?, looks.map_err(named)?));
        }
        let camera = camera_of(&camera)?;
        Ok(Shot { models, camera })
    }

    /// The picture's instances.
    pub(super) fn instances(&self) -> Vec<Instance<'_>> {
        let mut all = Vec::with_capacity(self.models.len());
        for (model, looks) in &self.models {
            all.push(Instance {
                world_from_model: looks.world_from_model,
                opacity: looks.opacity,
                tint: looks.tint,
                clip: looks.clip,
                ..Instance::new(model)
            });
        }
        all
    }
}

/// Place and looks of an instance.
///
/// # Safety
/// The pointers are null or valid for their counts and sizes.
unsafe fn looks(instance: &AshfallInstance) -> Result<Looks, Failure> {
    let mut looks = Looks {
        world_from_model: Similarity::IDENTITY,
        opacity: 1.0 - instance.fade,
        tint: [1.0; 3],
        clip: None,
    };
    if !instance.world_from_model.is_null() {
        // SAFETY: twelve numbers, as the caller says.
        let rows = unsafe { instance.world_from_model.cast::<[f64; 12]>().read_unaligned() };
        let found = Similarity::of_matrix(&affine(&rows));
        looks.world_from_model = found.map_err(|error| Failure::argument(error.to_string()))?;
    }
    if !instance.tint.is_null() {
        // SAFETY: three numbers, as the caller says.
        looks.tint = unsafe { instance.tint.cast::<[f32; 3]>().read_unaligned() };
    }
    // SAFETY: as the caller says.
    looks.clip = unsafe { optional(instance.clip) }?.map(|clip| ClipBox {
        world_from_cube: affine(&clip.world_from_cube),
        cuts_inside: clip.cuts_inside != 0,
    });
    Ok(looks)
}

/// Matrix of three rows of four numbers.
fn affine(rows: &[f64; 12]) -> DMat4 {
    let row = |at: usize| DVec4::new(rows[at], rows[at + 1], rows[at + 2], rows[at + 3]);
    DMat4::from_cols(row(0), row(4), row(8), DVec4::W).transpose()
}

impl Canvas {
    /// Images of a picture.
    ///
    /// # Safety
    /// As [`Shot::of`]; the images are as described.
    pub(super) unsafe fn of(draw: &AshfallDraw) -> Result<Canvas, Failure> {
        let blend = match draw.blend {
            ASHFALL_BLEND_REPLACE => Blend::Replace,
            ASHFALL_BLEND_PREMULTIPLIED => Blend::Premultiplied,
            ASHFALL_BLEND_OVER_DISPLAY => Blend::OverDisplay,
            ASHFALL_BLEND_OVER_LINEAR => Blend::OverLinear { gain: draw.gain },
            other => return Err(Failure::argument(format!("blend: {other} is none"))),
        };
        let is_sound = draw.background.iter().all(|value| value.is_finite()) && draw.near_plane.is_finite();
        if !is_sound {
            return Err(Failure::argument("background or near_plane: not finite"));
        }
        // SAFETY: as the caller says.
        let (color, depth) = unsafe { (image("color", draw.color, true)?, coded("depth", draw.depth, true)?) };
        let ids = match draw.ids.is_null() {
            true => None,
            // SAFETY: as the caller says.
            false => Some(unsafe { image("ids", draw.ids, false) }?),
        };
        // SAFETY: as the caller says.
        let (depth_out, pick) = unsafe { (coded("depth_out", draw.depth_out, false)?, optional(draw.pick)?) };
        Ok(Canvas {
            color,
            depth,
            blend,
            ids,
            depth_out,
            depth_kind: match draw.depth_out_expected {
                0 => DepthKind::Median,
                _ => DepthKind::Expected,
            },
            pick: pick.map(area),
            origin: (draw.part != 0).then_some(draw.origin),
            options: ViewOptions {
                background: draw.background,
                near: draw.near_plane,
                filter: Default::default(),
            },
        })
    }

    /// The images as the renderer takes them.
    pub(super) fn target(&self) -> HostTarget<'_> {
        HostTarget {
            blend: self.blend,
            depth: self.depth.as_ref().map(host_depth),
            ids: self.ids.as_ref(),
            depth_out: self.depth_out.as_ref().map(host_depth),
            depth_kind: self.depth_kind,
            pick: self.pick,
            origin: self.origin,
            ..HostTarget::from(&self.color)
        }
    }
}

fn host_depth((image, code): &(HostImage, DepthCode)) -> HostDepth<'_> {
    HostDepth { image, code: *code }
}

fn area(from: AshfallPickArea) -> PickArea {
    let AshfallPickArea {
        x, y, width, height, ..
    } = from;
    PickArea { x, y, width, height }
}

/// A host's depths and their code.
///
/// # Safety
/// As [`image`].
unsafe fn coded(
    name: &str,
    from: *const AshfallDepth,
    has_view: bool,
) -> Result<Option<(HostImage, DepthCode)>, Failure> {
    // SAFETY: as the caller says.
    let Some(depth) = unsafe { optional(from) }? else {
        return Ok(None);
    };
    let code = DepthCode {
        a: depth.a,
        b: depth.b,
        is_linear: depth.linear != 0,
        empty: depth.empty,
    };
    // SAFETY: as the caller says.
    Ok(Some((unsafe { image(name, depth.image, has_view) }?, code)))
}

/// A host's image; only those that are copied to do without a view.
///
/// # Safety
/// The pointer is null or valid for its size, and the image is as described.
unsafe fn image(name: &str, from: *const AshfallImage, has_view: bool) -> Result<HostImage, Failure> {
    // SAFETY: as the caller says.
    let found = unsafe { read(from) }.map_err(|failure| Failure::argument(format!("{name}: {}", failure.message)))?;
    if found.image == VkImage::null() || has_view && found.view == VkImageView::null() {
        return Err(Failure::argument(format!("{name}: a null image or view")));
    }
    if found.after.layout == VkImageLayout::UNDEFINED {
        return Err(Failure::argument(format!("{name}: its layout after is undefined")));
    }
    let state = |state: AshfallState| ImageState {
        layout: state.layout,
        stage: state.stage,
        access: state.access,
    };
    let desc = HostImageDesc {
        image: found.image,
        view: found.view,
        format: found.format,
        extent: [found.width, found.height],
        before: state(found.before),
        after: state(found.after),
    };
    // SAFETY: as the caller says.
    Ok(unsafe { HostImage::wrap(desc) }.at_layer(found.layer))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capi::picture::{AshfallCamera, AshfallClip};
    use crate::capi::projection::ashfall_depth_from_projection;
    use crate::capi::registry::{AshfallScene, LiveObject, insert, remove};
    use crate::gpu::ash::vk::{AccessFlags2, Format as VkFormat, Handle, PipelineStageFlags2};
    use glam::DVec3;

    fn zeroed<T: crate::capi::memory::Sized32>() -> T {
        // SAFETY: zero is a value of these structures.
        unsafe { std::mem::zeroed() }
    }

    fn image(format: VkFormat) -> AshfallImage {
        let state = AshfallState {
            layout: VkImageLayout::GENERAL,
            reserved: 0,
            stage: PipelineStageFlags2::COMPUTE_SHADER,
            access: AccessFlags2::SHADER_WRITE,
        };
        AshfallImage {
            size: size_of::<AshfallImage>() as u32,
            format,
            image: VkImage::from_raw(1),
            view: VkImageView::from_raw(2),
            width: 72,
            height: 50,
            before: state,
            after: state,
            layer: 0,
            reserved: 0,
        }
    }

    #[test]
    fn pictures_are_converted_as_they_are_described() {
        let (color, stored) = (image(VkFormat::R32G32B32A32_SFLOAT), image(VkFormat::D16_UNORM));
        let mut depth = AshfallDepth {
            size: size_of::<AshfallDepth>() as u32,
            image: &raw const stored,
            ..zeroed()
        };
        // Reversed, infinite: z' = 0.5, w = z, in view space along z.
        let mut projection = [0.0; 16];
        (projection[11], projection[14]) = (1.0, 0.5);
        // SAFETY: 16 numbers, and a structure of its size.
        let found = unsafe { ashfall_depth_from_projection(projection.as_ptr(), &raw mut depth) };
        assert_eq!(found, crate::capi::failure::ASHFALL_OK);
        let mut draw = AshfallDraw {
            size: size_of::<AshfallDraw>() as u32,
            color: &raw const color,
            depth: &raw const depth,
            blend: ASHFALL_BLEND_OVER_LINEAR,
            gain: 3.0,
            near_plane: 0.125,
            background: [0.25, 0.5, 0.75],
            ..zeroed()
        };
        // SAFETY: pointers to structures of their sizes.
        let canvas = unsafe { Canvas::of(&draw) }.unwrap();
        let target = canvas.target();
        let code = DepthCode {
            a: 0.0,
            b: 0.5,
            is_linear: false,
            empty: 0.0,
        };
        let lies = target.depth.unwrap();
        assert_eq!((lies.code, lies.image.image().extent()), (code, [72, 50]));
        assert_eq!(target.blend, Blend::OverLinear { gain: 3.0 });
        assert_eq!(
            (canvas.options.near, canvas.options.background),
            (0.125, [0.25, 0.5, 0.75])
        );
        (draw.depth, draw.blend) = (std::ptr::null(), ASHFALL_BLEND_PREMULTIPLIED);
        // SAFETY: as above.
        let canvas = unsafe { Canvas::of(&draw) }.unwrap();
        assert!(canvas.target().depth.is_none() && canvas.target().blend == Blend::Premultiplied);
        draw.background[1] = f32::NAN;
        // SAFETY: as above.
        let refused = unsafe { Canvas::of(&draw) }.unwrap_err();
        assert!(refused.message.contains("background"), "{refused:?}");
    }

    #[test]
    fn outputs_are_converted_as_they_are_described() {
        let copied = |format: VkFormat| AshfallImage {
            view: VkImageView::null(),
            ..image(format)
        };
        let (color, ids) = (image(VkFormat::R32G32B32A32_SFLOAT), copied(VkFormat::R32_UINT));
        let stored = copied(VkFormat::D32_SFLOAT);
        let depth_out = AshfallDepth {
            size: size_of::<AshfallDepth>() as u32,
            image: &raw const stored,
            linear: 1,
            a: 0.5,
            b: 0.25,
            ..zeroed()
        };
        let pick = AshfallPickArea {
            size: size_of::<AshfallPickArea>() as u32,
            x: 1,
            y: 2,
            width: 3,
            height: 4,
        };
        let mut draw = AshfallDraw {
            size: size_of::<AshfallDraw>() as u32,
            color: &raw const color,
            ids: &raw const ids,
            depth_out: &raw const depth_out,
            pick: &raw const pick,
            part: 1,
            depth_out_expected: 1,
            origin: [5, 6],
            ..zeroed()
        };
        // SAFETY: pointers to structures of their sizes.
        let canvas = unsafe { Canvas::of(&draw) }.unwrap();
        let target = canvas.target();
        let code = DepthCode {
            a: 0.5,
            b: 0.25,
            is_linear: true,
            empty: 0.0,
        };
        assert!(target.depth.is_none() && target.ids.is_some());
        assert_eq!((target.origin, target.depth_kind), (Some([5, 6]), DepthKind::Expected));
        assert!(target.depth_out.is_some_and(|out| out.code == code));
        assert_eq!(
            target.pick,
            Some(PickArea {
                x: 1,
                y: 2,
                width: 3,
                height: 4
            })
        );
        // Images that are read have views.
        draw.depth = &raw const depth_out;
        // SAFETY: as above.
        let refused = unsafe { Canvas::of(&draw) }.unwrap_err();
        assert_eq!(refused.message, "depth: a null image or view");
    }

    #[test]
    fn cameras_are_row_by_row_and_instances_named() {
        let mut camera = AshfallCamera {
            size: size_of::<AshfallCamera>() as u32,
            width: 72,
            height: 50,
            focal: [60.0, 61.0],
            rotation: [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            position: [1.0, 2.0, 3.0],
            ..zeroed()
        };
        let mut draw = AshfallDraw {
            camera: &raw const camera,
            ..zeroed()
        };
        // SAFETY: pointers to structures of their sizes.
        let shot = unsafe { Shot::of(&draw) }.unwrap();
        let seen = shot.camera.view_from_world(DVec3::new(1.5, 2.0, 3.0));
        assert_eq!(seen, DVec3::new(0.0, -0.5, 0.0));
        let scene: *mut AshfallScene = insert(LiveObject::Scene(Arc::default()));
        let instance = AshfallInstance {
            size: size_of::<AshfallInstance>() as u32,
            model: scene.cast(),
            ..zeroed()
        };
        (draw.instances, draw.instance_count) = (&raw const instance, 1);
        // SAFETY: as above.
        let refused = unsafe { Shot::of(&draw) }.unwrap_err();
        assert_eq!(refused.message, "instance 0: model: the handle of a scene");
        remove(scene).unwrap();
        (draw.instance_count, camera.focal[0]) = (0, 0.0);
        draw.camera = &raw const camera;
        // SAFETY: as above.
        let refused = unsafe { Shot::of(&draw) }.unwrap_err();
        assert!(refused.message.contains("no focal length"), "{refused:?}");
    }

    #[test]
    fn places_and_looks_are_converted_as_they_are_described() {
        // A quarter turn about z, scale 2.
        let rows = [0.0, -2.0, 0.0, 1.0, 2.0, 0.0, 0.0, 3.0, 0.0, 0.0, 2.0, 5.0];
        let tint = [0.5_f32, 1.0, 0.25];
        let clip = AshfallClip {
            size: size_of::<AshfallClip>() as u32,
            cuts_inside: 1,
            world_from_cube: rows,
        };
        let mut instance = AshfallInstance {
            world_from_model: rows.as_ptr(),
            tint: tint.as_ptr(),
            clip: &raw const clip,
            fade: 0.25,
            ..zeroed()
        };
        // SAFETY: pointers to arrays and structures of their sizes.
        let found = unsafe { looks(&instance) }.unwrap();
        let point = found.world_from_model.point(DVec3::new(1.0, 2.0, 3.0));
        assert!((point - DVec3::new(-3.0, 5.0, 11.0)).length() < 1e-14, "{point}");
        assert_eq!((found.opacity, found.tint), (0.75, tint));
        let cut = found.clip.unwrap();
        assert!(cut.cuts_inside && cut.world_from_cube.transform_point3(DVec3::X) == DVec3::new(1.0, 5.0, 5.0));
        instance = zeroed();
        // SAFETY: null pointers.
        let found = unsafe { looks(&instance) }.unwrap();
        assert_eq!((found.world_from_model, found.opacity), (Similarity::IDENTITY, 1.0));
        assert!(found.tint == [1.0; 3] && found.clip.is_none());
    }
}
