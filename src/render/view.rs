//! View parameters of the kernels, from a camera and options.

use crate::layout::{TILE_HEIGHT, TILE_WIDTH, View};
use crate::scene::{Camera, Primitive, ScreenFilter};

/// Margin around the image beyond which the Jacobian's direction is clamped, as a share of the image size: 0.15, which
/// is 1.3 times the tangent of half the field of view when centred (3DGS code).
const BORDER: f64 = 0.15;

/// Options of a frame besides its camera.
#[derive(Clone, Copy, Debug)]
pub struct ViewOptions {
    /// RGB of the background, 0 to 1.
    pub background: [f32; 3],
    /// Near plane in world units along z: nearer splats are not drawn, and splats behind the camera never are.
    pub near: f32,
    /// Filter on the screen, that of training.
    pub filter: ScreenFilter,
}

/// The same view of splats of a kind. Surfels are projected exactly, so that directions have no limit, and are dilated
/// by the mip filter alone.
pub(super) fn view_on(view: &View, primitive: Primitive) -> View {
    match primitive {
        Primitive::Gaussian3d => *view,
        Primitive::Surfel => View {
            limit: [-f32::MAX, f32::MAX, -f32::MAX, f32::MAX],
            dilation: if view.compensate == 0 { 0.0 } else { view.dilation },
            ..*view
        },
    }
}

/// View parameters of the kernels, on 3D Gaussians; see [`view_on`].
pub fn view_of(camera: &Camera, options: &ViewOptions) -> View {
    let size = [camera.width, camera.height];
    let limits = |axis: usize| {
        let (extent, focal, center) = (f64::from(size[axis]), camera.focal[axis], camera.center[axis]);
        let margin = BORDER * extent / focal;
        (
            (-center / focal - margin) as f32,
            ((extent - center) / focal + margin) as f32,
        )
    };
    let ((x_min, x_max), (y_min, y_max)) = (limits(0), limits(1));
    View {
        view_from_world: camera.rotation.as_mat3().to_cols_array_2d(),
        position: camera.position.as_vec3().to_array(),
        focal: camera.focal.as_vec2().to_array(),
        center: camera.center.as_vec2().to_array(),
        limit: [x_min, x_max, y_min, y_max],
        size,
        tiles: [size[0].div_ceil(TILE_WIDTH), size[1].div_ceil(TILE_HEIGHT)],
        // Depths are always positive: their bits then sort as integers, and nothing behind the camera is drawn.
        near_plane: options.near.max(f32::MIN_POSITIVE),
        dilation: options.filter.dilation() as f32,
        compensate: options.filter.keeps_light().into(),
        background: options.background,
        dropout: 0,
        dropout_key: 0,
        first_row: 0,
    }
}
