//! Cameras and codes of depths from a host's matrices.

use super::failure::{AshfallResult, Failure, guard};
use super::memory::{check, read, write};
use super::picture::{AshfallCamera, AshfallDepth};
use crate::render::DepthCode;
use crate::scene::{Camera, ClipAxes};
use glam::{DMat3, DMat4, DVec2, DVec3};

/// Fills a camera from a perspective matrix: clip space from the world (projection times view), 16 numbers column by
/// column. Depth, near and far plane do not count; a jitter moves the principal point.
///
/// `y_up`: 0 for clip space with y down (Vulkan), 1 for y up. `camera`: size, width and height are read, the rest is
/// written.
///
/// # Safety
/// `clip_from_world` is null or valid for 16 numbers, `camera` is null or valid for its size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_camera_from_matrix(
    clip_from_world: *const f64,
    y_up: u32,
    camera: *mut AshfallCamera,
) -> AshfallResult {
    // SAFETY: as the caller says.
    guard(|| unsafe { fill(clip_from_world, y_up, camera, Camera::from_matrix) })
}

/// As ashfall_camera_from_matrix, from an orthographic matrix, for renderers with ASHFALL_ORTHOGRAPHIC; depth 0 to 1,
/// reversed or not.
///
/// # Safety
/// As of ashfall_camera_from_matrix.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_camera_from_orthographic(
    clip_from_world: *const f64,
    y_up: u32,
    camera: *mut AshfallCamera,
) -> AshfallResult {
    // SAFETY: as the caller says.
    guard(|| unsafe { fill(clip_from_world, y_up, camera, Camera::from_orthographic) })
}

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
    // SAFETY: as the caller says.
    guard(|| unsafe { encode("clip_from_view", clip_from_view, depth, DepthCode::of_projection) })
}

/// As ashfall_depth_from_projection, from an orthographic matrix, clip space from the world, in a picture through the
/// camera that ashfall_camera_from_orthographic fills.
///
/// # Safety
/// As of ashfall_depth_from_projection; `camera` is null or valid for its size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ashfall_depth_from_orthographic(
    clip_from_world: *const f64,
    camera: *const AshfallCamera,
    depth: *mut AshfallDepth,
) -> AshfallResult {
    guard(|| {
        // SAFETY: as the caller says.
        let camera = camera_of(&unsafe { read(camera) }?)?;
        let code = |matrix: &DMat4| DepthCode::of_orthographic(matrix, &camera);
        // SAFETY: as the caller says.
        unsafe { encode("clip_from_world", clip_from_world, depth, code) }
    })
}

/// Matrix of 16 numbers.
///
/// # Safety
/// The pointer is null or valid for them.
unsafe fn matrix(name: &str, from: *const f64) -> Result<DMat4, Failure> {
    check(name, from)?;
    // SAFETY: as the caller says.
    let numbers = unsafe { from.cast::<[f64; 16]>().read_unaligned() };
    Ok(DMat4::from_cols_array(&numbers))
}

/// Camera of a matrix.
///
/// # Safety
/// As of [`ashfall_camera_from_matrix`].
unsafe fn fill(
    from: *const f64,
    y_up: u32,
    camera: *mut AshfallCamera,
    of: fn(&DMat4, [u32; 2], ClipAxes) -> crate::Result<Camera>,
) -> Result<(), Failure> {
    // SAFETY: as the caller says.
    let (matrix, before) = unsafe { (matrix("clip_from_world", from)?, read(camera)?) };
    let axes = match y_up {
        0 => ClipAxes::YDown,
        _ => ClipAxes::YUp,
    };
    let found = of(&matrix, [before.width, before.height], axes)?;
    let value = AshfallCamera {
        focal: found.focal.to_array(),
        center: found.center.to_array(),
        rotation: found.rotation.transpose().to_cols_array(),
        position: found.position.to_array(),
        ..before
    };
    // SAFETY: as the caller says.
    unsafe { write(camera, &value) }
}

/// Code of the depths of a matrix.
///
/// # Safety
/// As of [`ashfall_depth_from_projection`].
unsafe fn encode(
    name: &str,
    from: *const f64,
    depth: *mut AshfallDepth,
    of: impl FnOnce(&DMat4) -> crate::Result<DepthCode>,
) -> Result<(), Failure> {
    // SAFETY: as the caller says.
    let (matrix, before) = unsafe { (matrix(name, from)?, read(depth)?) };
    let code = of(&matrix)?;
    let value = AshfallDepth {
        linear: code.is_linear.into(),
        a: code.a,
        b: code.b,
        empty: code.empty,
        ..before
    };
    // SAFETY: as the caller says.
    unsafe { write(depth, &value) }
}

/// The camera, with finite numbers.
pub(super) fn camera_of(from: &AshfallCamera) -> Result<Camera, Failure> {
    let camera = Camera {
        width: from.width,
        height: from.height,
        focal: DVec2::from(from.focal),
        center: DVec2::from(from.center),
        rotation: DMat3::from_cols_array(&from.rotation).transpose(),
        position: DVec3::from(from.position),
    };
    let is_finite = camera.center.is_finite() && camera.rotation.is_finite() && camera.position.is_finite();
    match is_finite && camera.focal.is_finite() && camera.focal.min_element() > 0.0 {
        true => Ok(camera),
        false => Err(Failure::argument(format!(
            "camera: not finite, or no focal length: {camera:?}"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capi::failure::ASHFALL_OK;
    use glam::DVec4;

    fn sized_camera() -> AshfallCamera {
        AshfallCamera {
            size: size_of::<AshfallCamera>() as u32,
            width: 80,
            height: 60,
            reserved: 0,
            focal: [0.0; 2],
            center: [0.0; 2],
            rotation: [0.0; 9],
            position: [0.0; 3],
        }
    }

    #[test]
    fn cameras_of_matrices_are_those_of_the_rust_interface() {
        let view = DMat4::from_rotation_y(0.75) * DMat4::from_translation(DVec3::new(3.0, -1.0, 2.0));
        let perspective = DMat4::from_cols(
            DVec4::new(1.5, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 2.0, 0.0, 0.0),
            DVec4::new(0.0, 0.0, 0.0, 1.0),
            DVec4::new(0.0, 0.0, 0.125, 0.0),
        ) * view;
        let orthographic = DMat4::from_cols(
            DVec4::new(0.5, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 0.25, 0.0, 0.0),
            DVec4::new(0.0, 0.0, 0.125, 0.0),
            DVec4::W,
        ) * view;
        let size = [80, 60];
        let numbers = [perspective, orthographic].map(|matrix| matrix.to_cols_array());
        let mut found = [sized_camera(); 3];
        let [a, b, c] = &mut found;
        // SAFETY: matrices of 16 numbers, structures of their sizes.
        let results = unsafe {
            [
                ashfall_camera_from_matrix(numbers[0].as_ptr(), 0, a),
                ashfall_camera_from_matrix(numbers[0].as_ptr(), 1, b),
                ashfall_camera_from_orthographic(numbers[1].as_ptr(), 0, c),
            ]
        };
        // Turned over, the picture is mirrored.
        assert_eq!(results[0], ASHFALL_OK);
        assert_ne!(results[1], ASHFALL_OK);
        assert_eq!(results[2], ASHFALL_OK);
        let wanted = Camera::from_matrix(&perspective, size, ClipAxes::YDown).unwrap();
        assert_eq!(camera_of(&found[0]).unwrap(), wanted);
        let wanted = Camera::from_orthographic(&orthographic, size, ClipAxes::YDown).unwrap();
        assert_eq!(camera_of(&found[2]).unwrap(), wanted);

        let mut depth = AshfallDepth {
            size: size_of::<AshfallDepth>() as u32,
            linear: 0,
            image: std::ptr::null(),
            a: 0.0,
            b: 0.0,
            empty: 0.0,
            reserved: 0,
        };
        // SAFETY: as above.
        let result = unsafe { ashfall_depth_from_orthographic(numbers[1].as_ptr(), &raw const found[2], &mut depth) };
        assert_eq!(result, ASHFALL_OK);
        let code = DepthCode::of_orthographic(&orthographic, &wanted).unwrap();
        assert_eq!(
            (depth.linear, depth.a, depth.b, depth.empty),
            (1, code.a, code.b, code.empty)
        );
    }
}
