//! Structures of a picture: image, depth, camera, instance, pixels to report.

use super::memory::sized;
use super::registry::AshfallModel;
use crate::gpu::ash::vk::{
    AccessFlags2 as VkAccessFlags2, Format as VkFormat, Image as VkImage, ImageLayout as VkImageLayout,
    ImageView as VkImageView, PipelineStageFlags2 as VkPipelineStageFlags2,
};

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

/// A host's image with one mip level and layer, or a layer of several; barriers between its states are the renderer's.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallImage {
    /// sizeof(AshfallImage).
    pub size: u32,
    /// Format of the view; of a view of depth, of the image.
    pub format: VkFormat,
    /// The image, with the storage usage to be written, with the sampled usage to be read.
    pub image: VkImage,
    /// View of it with the type 2D; of an image with depth and stencil, of its depth. Null for ids and depth_out, to
    /// which is copied.
    pub view: VkImageView,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// State when the commands run.
    pub before: AshfallState,
    /// State afterwards; its layout is not VK_IMAGE_LAYOUT_UNDEFINED.
    pub after: AshfallState,
    /// Array layer of the view; barriers leave other layers as they are.
    pub layer: u32,
    /// 0.
    pub reserved: u32,
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
    /// The image, resolved, of the color's size.
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
    /// Focal lengths in pixels; in an orthographic picture, pixels per world unit.
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
    /// World from model as an affine matrix of three rows of four numbers: rotation, uniform scale and translation;
    /// null for the identity.
    pub world_from_model: *const f64,
    /// Factors of red, green and blue, from 0 on; null for 1.
    pub tint: *const f32,
    /// Box that clips the splats; null for none.
    pub clip: *const AshfallClip,
    /// Share of the opacities that is taken away, 0 to 1: 0 leaves them, at 1 nothing is drawn.
    pub fade: f32,
    /// 0.
    pub reserved_end: u32,
}

/// A box in the world that clips splats by their means.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallClip {
    /// sizeof(AshfallClip).
    pub size: u32,
    /// 0: splats outside are left out; 1: those inside.
    pub cuts_inside: u32,
    /// World from the cube between -1 and 1 as an affine matrix of three rows of four numbers: the box.
    pub world_from_cube: [f64; 12],
}

/// Pixels of a picture to report: up to 65,536 of a rectangle within it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallPickArea {
    /// sizeof(AshfallPickArea).
    pub size: u32,
    /// First column.
    pub x: u32,
    /// First row, from the top.
    pub y: u32,
    /// Columns, from 1 on.
    pub width: u32,
    /// Rows, from 1 on.
    pub height: u32,
}

/// A picture.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct AshfallDraw {
    /// sizeof(AshfallDraw).
    pub size: u32,
    /// Number of instances; their splats are sorted together.
    pub instance_count: u32,
    /// The instances.
    pub instances: *const AshfallInstance,
    /// The camera, of the picture's size.
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
    /// Image of the format R32_UINT for the splat of each pixel, with the usage as destination of transfers; null for
    /// none. The renderer has ASHFALL_IDS, as for the next two. Splats are counted through the instances, the first of
    /// each at a multiple of 64; pixels without one have ASHFALL_NO_SPLAT.
    pub ids: *const AshfallImage,
    /// Image of the format D32 or R32F for the depth of that splat's mean, or of the host's surface before it, with the
    /// usage as destination of transfers; null for none. Copies to D32 take a queue with graphics.
    pub depth_out: *const AshfallDepth,
    /// Pixels that ashfall_take_pick reports when the frame is done; null for none.
    pub pick: *const AshfallPickArea,
    /// 0: the camera has the images' size; 1: the picture takes a rectangle of the camera's size in all images, and
    /// other pixels are kept unless the state before discards them.
    pub part: u32,
    /// Column and row of the rectangle's first pixel.
    pub origin: [u32; 2],
    /// 0: depth_out has the depth of the splat in `ids`; 1: the mean depth of the splats by their weights, where they
    /// cover at least half of the pixel; the renderer has ASHFALL_EXPECTED_DEPTH, too.
    pub depth_out_expected: u32,
}

sized!(
    AshfallImage,
    AshfallDepth,
    AshfallCamera,
    AshfallClip,
    AshfallInstance,
    AshfallPickArea,
    AshfallDraw
);
