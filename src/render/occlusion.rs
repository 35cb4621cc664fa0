//! Pictures behind a host's surfaces: splats farther than the host's depth at a pixel do not count there.

use super::forward::Forward;
use super::options::RenderOptions;
use super::scratch::Scratch;
use crate::gpu::{Gpu, HostImage, Recorder};
use crate::kernels::linearize::{Bindings, Choice, Linearize, Params};
use crate::layout::{TILE_HEIGHT, TILE_WIDTH};
use crate::scene::Camera;
use crate::{Error, Result};
use glam::DMat4;

/// Code of a stored depth: `a + b / z`, or `a + b · z` if linear; `z` is the distance along the camera's z axis in
/// world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthCode {
    /// Constant term.
    pub a: f32,
    /// Factor of 1 / z, or of z.
    pub b: f32,
    /// True for values linear in z.
    pub is_linear: bool,
    /// Value of pixels without a surface, to which the image was cleared: nothing is hidden there.
    pub empty: f32,
}

impl DepthCode {
    /// Distances along z themselves, infinite where there is no surface.
    pub const DISTANCE: DepthCode = DepthCode {
        a: 0.0,
        b: 1.0,
        is_linear: true,
        empty: f32::INFINITY,
    };

    /// Code of a perspective projection (clip space from view space, columns as of GLSL, depth 0 to 1, view space along
    /// z or −z): reversed or not, with a finite or an infinite far plane. Cleared pixels have the value of the far
    /// plane's side, 0 if reversed and 1 if not.
    ///
    /// # Errors
    /// [`Error::Config`] for a matrix that is no such projection.
    pub fn of_projection(clip_from_view: &DMat4) -> Result<DepthCode> {
        let (z, w) = (clip_from_view.z_axis, clip_from_view.w_axis);
        let (a, b) = (z.z / z.w, w.z);
        if z.w.abs() != 1.0 || w.w != 0.0 || !a.is_finite() || !b.is_finite() || b == 0.0 {
            let what = format!("depths of the projection {clip_from_view}: not of the form a + b / z");
            return Err(Error::Config(what));
        }
        Ok(DepthCode {
            a: a as f32,
            b: b as f32,
            is_linear: false,
            empty: if b > 0.0 { 0.0 } else { 1.0 },
        })
    }

    /// Code of an orthographic projection (clip space from the world, columns as of GLSL, depth 0 to 1), reversed or
    /// not, in a picture through `camera`, as of [`Camera::from_orthographic`].
    ///
    /// # Errors
    /// [`Error::Config`] for a matrix that is no such projection.
    pub fn of_orthographic(clip_from_world: &DMat4, camera: &Camera) -> Result<DepthCode> {
        let [z, w] = [2, 3].map(|row| clip_from_world.row(row));
        let a = (z.truncate().dot(camera.position) + z.w) / w.w;
        let b = z.truncate().dot(camera.rotation.row(2)) / w.w;
        if w.truncate() != glam::DVec3::ZERO || !a.is_finite() || !b.is_finite() || b == 0.0 {
            let what = format!("depths of the projection {clip_from_world}: not of the form a + b z");
            return Err(Error::Config(what));
        }
        Ok(DepthCode {
            a: a as f32,
            b: b as f32,
            is_linear: true,
            empty: if b > 0.0 { 1.0 } else { 0.0 },
        })
    }
}

/// A host's resolved depth image of the colour image's size, in any format that can be sampled, with its state before
/// and after.
#[derive(Clone, Copy, Debug)]
pub struct HostDepth<'a> {
    /// The image, with the sampled usage.
    pub image: &'a HostImage,
    /// Code of its values.
    pub code: DepthCode,
}

/// Kernels of pictures behind a host's surfaces.
#[derive(Debug)]
pub(super) struct Occlusion {
    linearize: Linearize,
    pub(super) forward: Forward,
}

impl Occlusion {
    pub(super) fn new(gpu: &Gpu, options: &RenderOptions) -> Result<Occlusion> {
        Ok(Occlusion {
            linearize: Linearize::new(gpu, Choice::default())?,
            forward: Forward::for_limits(gpu, options)?,
        })
    }

    /// Checks a host's depth.
    ///
    /// # Errors
    /// [`Error::Config`] for a code that is no number, [`Error::Unsupported`] for a format that is not sampled.
    pub(super) fn check(gpu: &Gpu, depth: &HostDepth<'_>) -> Result<()> {
        depth.image.check_readable(gpu)?;
        let code = depth.code;
        match code.a.is_finite() && code.b.is_finite() && code.b != 0.0 {
            true => Ok(()),
            false => Err(Error::Config(format!("{code:?}: a and b are numbers, and b is not 0"))),
        }
    }

    /// Records the reading of `size` pixels of a host's depth from `origin` on into the limits of `scratch`.
    pub(super) fn read(
        &self,
        rec: &mut Recorder<'_>,
        depth: &HostDepth<'_>,
        (origin, size): ([u32; 2], [u32; 2]),
        scratch: &Scratch,
    ) {
        let code = depth.code;
        rec.acquire_to_read(depth.image);
        let io = Bindings {
            stored: &depth.image.readable(),
            limit_from_pixel: &scratch.limit_from_pixel,
            limit_from_tile: &scratch.limit_from_tile,
        };
        let params = Params {
            a: code.a,
            b: code.b,
            linear: code.is_linear.into(),
            empty: code.empty,
            size,
            origin,
        };
        let tiles = size[0].div_ceil(TILE_WIDTH) * size[1].div_ceil(TILE_HEIGHT);
        self.linearize
            .record(rec, io, params, self.linearize.groups(tiles as usize));
        rec.release_read(depth.image);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ClipAxes;
    use glam::{DVec3, DVec4};

    /// Projection with the view along z or −z (`forward` 1 or −1) that takes `near` to `at_near` and `far` to `at_far`.
    fn projection(forward: f64, (near, at_near): (f64, f64), (far, at_far): (f64, f64)) -> DMat4 {
        // The stored depth a + b / z through both points.
        let b = (at_near - at_far) / (near.recip() - far.recip());
        let a = at_near - b / near;
        DMat4::from_cols(
            DVec4::X,
            DVec4::Y,
            DVec4::new(0.0, 0.0, a * forward, forward),
            DVec4::new(0.0, 0.0, b, 0.0),
        )
    }

    /// The usual projections, right-handed and left-handed; depths of points by the matrix itself.
    #[test]
    fn codes_of_projections_are_their_depths() {
        let (near, far) = (0.5, 40.0);
        for forward in [1.0, -1.0] {
            for (far, at_near, at_far) in [(far, 0.0, 1.0), (far, 1.0, 0.0), (f64::INFINITY, 1.0, 0.0)] {
                let matrix = projection(forward, (near, at_near), (far, at_far));
                let code = DepthCode::of_projection(&matrix).unwrap();
                for z in [0.5, 1.0, 7.0, 39.0] {
                    let clip = matrix * DVec4::new(0.0, 0.0, z * forward, 1.0);
                    let stored = f64::from(code.a) + f64::from(code.b) / z;
                    assert!((clip.z / clip.w - stored).abs() < 1e-6, "{matrix} at {z}: {stored}");
                }
                assert_eq!(f64::from(code.empty), at_far, "{matrix}");
            }
        }
        let mut orthographic = projection(1.0, (near, 0.0), (far, 1.0));
        (orthographic.z_axis.w, orthographic.w_axis.w) = (0.0, 1.0);
        assert!(DepthCode::of_projection(&orthographic).is_err());
        assert!(DepthCode::of_projection(&DMat4::ZERO).is_err());
    }

    #[test]
    fn codes_of_orthographic_projections_are_their_depths() {
        for [at_near, at_far] in [[0.0, 1.0], [1.0, 0.0]] {
            let slope = (at_far - at_near) / 7.75;
            let projection = DMat4::from_cols(
                DVec4::X,
                DVec4::Y,
                DVec4::new(0.0, 0.0, slope, 0.0),
                DVec4::new(0.0, 0.0, at_near - 0.25 * slope, 1.0),
            );
            let matrix =
                projection * DMat4::from_rotation_y(0.75) * DMat4::from_translation(DVec3::new(3.0, -1.0, 2.0));
            let camera = Camera::from_orthographic(&matrix, [8, 8], ClipAxes::YDown).unwrap();
            let code = DepthCode::of_orthographic(&matrix, &camera).unwrap();
            assert!(code.is_linear && f64::from(code.empty) == at_far, "{code:?}");
            for z in [0.0, 1.0, 7.0] {
                let clip = matrix.project_point3(camera.position + z * camera.rotation.row(2));
                let stored = f64::from(code.a) + f64::from(code.b) * z;
                assert!(
                    (clip.z - stored).abs() < 1e-6,
                    "{code:?} at {z}: {stored}, not {}",
                    clip.z
                );
            }
            assert!(DepthCode::of_orthographic(&DMat4::ZERO, &camera).is_err());
        }
    }
}
