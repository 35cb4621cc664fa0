//! Pictures as C describes them: images, camera, instances, and their conversion.

use super::failure::{AshfallResult, Failure, guard};
use super::memory::{array, check, optional, read, sized, write};
use super::registry::{AshfallModel, find};
use crate::gpu::ash::vk::{
    AccessFlags2 as VkAccessFlags2, Format as VkFormat, Image as VkImage, ImageLayout as VkImageLayout,
    ImageView as VkImageView, PipelineStageFlags2 as VkPipelineStageFlags2,
};
use crate::gpu::{HostImage, HostImageDesc, ImageState};
use crate::render::{Blend, DepthCode, HostDepth, HostTarget, Model, ViewOptions};
use crate::scene::Camera;
use glam::{DMat3, DMat4, DVec2, DVec3};
use std::sync::Arc;

/// Blending of splats with the pixels of the image.
pub type AshfallBlend = u32;
/// Splats over `background`, with their opacity as alpha: replaces the pixels.
pub const ASHFALL_BLEND_REPLACE: AshfallBlend = 0;
/// Premultiplied colour with alpha, for a blending of the host's: replaces the pixels.
pub const ASHFALL_BLEND_PREMULTIPLIED: AshfallBlend = 1;
/// Splats over pixels of display values; the renderer has ASHFALL_HOST_COLOR.
pub const ASHFALL_BLEND_OVER_DISPLAY: AshfallBlend = 2;
/// Splats over pixels of linear light, with `gain` as the light of a display value of 1; as above.
pub const ASHFALL_BLEND_OVER_LINEAR: AshfallBlend = 3;

/// State of an image.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallState {
    /// Layout.
    pub layout: VkImageLayout,
    /// 0.
    pub reserved: u32,
    /// Stages of the access.
    pub stage: VkPipelineStageFlags2,
    /// Access in those stages.
    pub access: VkAccessFlags2,
}

/// A host's image with one mip level and layer; barriers between its states are the renderer's.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallImage {
    /// sizeof(AshfallImage).
    pub size: u32,
    /// Format of the view; of a view of depth, of the image.
    pub format: VkFormat,
    /// The image, with the storage usage to be written, with the sampled usage to be read.
    pub image: VkImage,
    /// View of all of it; of an image with depth and stencil, of its depth.
    pub view: VkImageView,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// State when the commands run.
    pub before: AshfallState,
    /// State afterwards; its layout is not VK_IMAGE_LAYOUT_UNDEFINED.
    pub after: AshfallState,
}

/// Depths of the host's surfaces, which hide the splats behind them; the renderer has ASHFALL_HOST_DEPTH. A stored
/// value is a + b / z, or a + b z if linear, of the distance z along the camera's axis.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallDepth {
    /// sizeof(AshfallDepth).
    pub size: u32,
    /// 1 for values linear in z, else 0.
    pub linear: u32,
    /// The image, resolved, of the picture's size.
    pub image: *const AshfallImage,
    /// Constant term.
    pub a: f32,
    /// Factor of 1 / z, or of z.
    pub b: f32,
    /// Value of pixels without a surface, to which the image was cleared.
    pub empty: f32,
    /// 0.
    pub reserved: u32,
}

/// A camera: x right, y down, z forward; pixel centres at + 0.5.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallCamera {
    /// sizeof(AshfallCamera).
    pub size: u32,
    /// Width of the image in pixels.
    pub width: u32,
    /// Height of the image in pixels.
    pub height: u32,
    /// 0.
    pub reserved: u32,
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels.
    pub center: [f64; 2],
    /// View from world, row by row: its rows are the camera's axes in the world.
    pub rotation: [f64; 9],
    /// Centre in world units.
    pub position: [f64; 3],
}

/// A model in a picture.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallInstance {
    /// sizeof(AshfallInstance).
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// The model.
    pub model: *mut AshfallModel,
}

/// A picture.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallDraw {
    /// sizeof(AshfallDraw).
    pub size: u32,
    /// Number of instances.
    pub instance_count: u32,
    /// The instances.
    pub instances: *const AshfallInstance,
    /// The camera, of the image's size.
    pub camera: *const AshfallCamera,
    /// Image to draw to; not read by ashfall_renderer_reserve.
    pub color: *const AshfallImage,
    /// Depths of the host's surfaces; null for none.
    pub depth: *const AshfallDepth,
    /// Blending with the image's pixels.
    pub blend: AshfallBlend,
    /// Gain of ASHFALL_BLEND_OVER_LINEAR.
    pub gain: f32,
    /// Background of ASHFALL_BLEND_REPLACE, 0 to 1.
    pub background: [f32; 3],
    /// Near plane in world units: splats with nearer means are not drawn.
    pub near_plane: f32,
}

sized!(AshfallImage, AshfallDepth, AshfallCamera, AshfallInstance, AshfallDraw);

/// Fills `linear`, `a`, `b` and `empty` from a perspective projection: clip space from view space, 16 numbers column by
/// column, depth 0 to 1, reversed or not, with a finite or an infinite far plane.
///
/// # Safety
/// `clip_from_view` is null or valid for 16 numbers, `depth` is null or valid for its size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_depth_from_projection(
    clip_from_view: *const f64,
    depth: *mut AshfallDepth,
) -> AshfallResult {
    guard(|| {
        check("clip_from_view", clip_from_view)?;
        // SAFETY: as the caller says.
        let (matrix, before) = unsafe { (clip_from_view.cast::<[f64; 16]>().read_unaligned(), read(depth)?) };
        let code = DepthCode::of_projection(&DMat4::from_cols_array(&matrix))?;
        let value = AshfallDepth {
            linear: code.is_linear.into(),
            a: code.a,
            b: code.b,
            empty: code.empty,
            ..before
        };
        // SAFETY: as the caller says.
        unsafe { write(depth, &value) }
    })
}

/// Models and camera of a picture.
#[derive(Debug)]
pub(super) struct Shot {
    pub(super) models: Vec<Arc<Model>>,
    pub(super) camera: Camera,
}

/// Images of a picture, and the blending with them.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) color: HostImage,
    depth: Option<(HostImage, DepthCode)>,
    blend: Blend,
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
            models.push(find(instance.model).map_err(named)?);
        }
        let camera = Camera {
            width: camera.width,
            height: camera.height,
            focal: DVec2::from(camera.focal),
            center: DVec2::from(camera.center),
            rotation: DMat3::from_cols_array(&camera.rotation).transpose(),
            position: DVec3::from(camera.position),
        };
        let is_finite = camera.center.is_finite() && camera.rotation.is_finite() && camera.position.is_finite();
        if !is_finite || !camera.focal.is_finite() || camera.focal.min_element() <= 0.0 {
            return Err(Failure::argument(format!(
                "camera: not finite, or no focal length: {camera:?}"
            )));
        }
        Ok(Shot { models, camera })
    }

    /// The picture's model.
    pub(super) fn model(&self) -> Result<&Model, Failure> {
        match &self.models[..] {
            [model] => Ok(model),
            all => Err(Failure::argument(format!("{} instances: one is drawn", all.len()))),
        }
    }
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
        let (color, depth) = unsafe { (image("color", draw.color)?, optional(draw.depth)?) };
        let depth = match depth {
            None => None,
            Some(depth) => {
                let code = DepthCode {
                    a: depth.a,
                    b: depth.b,
                    is_linear: depth.linear != 0,
                    empty: depth.empty,
                };
                // SAFETY: as the caller says.
                Some((unsafe { image("depth", depth.image) }?, code))
            }
        };
        Ok(Canvas {
            color,
            depth,
            blend,
            options: ViewOptions {
                background: draw.background,
                near: draw.near_plane,
                filter: Default::default(),
            },
        })
    }

    /// The images as the renderer takes them.
    pub(super) fn target(&self) -> HostTarget<'_> {
        let depth = self
            .depth
            .as_ref()
            .map(|(image, code)| HostDepth { image, code: *code });
        HostTarget {
            color: &self.color,
            blend: self.blend,
            depth,
        }
    }
}

/// A host's image.
///
/// # Safety
/// The pointer is null or valid for its size, and the image is as described.
unsafe fn image(name: &str, from: *const AshfallImage) -> Result<HostImage, Failure> {
    // SAFETY: as the caller says.
    let found = unsafe { read(from) }.map_err(|failure| Failure::argument(format!("{name}: {}", failure.message)))?;
    if found.image == VkImage::null() || found.view == VkImageView::null() {
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
    Ok(unsafe { HostImage::wrap(desc) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capi::registry::{AshfallScene, LiveObject, insert, remove};
    use crate::gpu::ash::vk::Handle;

    fn zeroed<T: crate::capi::memory::Sized32>() -> T {
        // SAFETY: zero is a value of these structures.
        unsafe { std::mem::zeroed() }
    }

    fn image(format: VkFormat) -> AshfallImage {
        let state = AshfallState {
            layout: VkImageLayout::GENERAL,
            reserved: 0,
            stage: VkPipelineStageFlags2::COMPUTE_SHADER,
            access: VkAccessFlags2::SHADER_WRITE,
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
}
