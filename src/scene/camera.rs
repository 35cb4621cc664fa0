//! A pinhole camera: intrinsics in pixels, pose in the world.

use crate::{Error, Result};
use glam::{DMat3, DMat4, DVec2, DVec3};

/// A pinhole camera. Lens distortion is removed from photographs when they are loaded.
///
/// A world point `p` has the view coordinates `v = rotation * (p - position)` (x right, y down,
/// z forward) and the pixel coordinates `(fx v.x / v.z + cx, fy v.y / v.z + cy)`, where pixel
/// `(i, j)` covers `[i, i + 1) × [j, j + 1)` and has its centre at `(i + 0.5, j + 0.5)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Focal lengths in pixels (x, y).
    pub focal: DVec2,
    /// Principal point in pixels (x, y).
    pub center: DVec2,
    /// `view_from_world`, orthonormal.
    pub rotation: DMat3,
    /// The camera's centre in world units.
    pub position: DVec3,
}

/// Rays of a picture's pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Projection {
    /// Through the camera's centre, as of [`Camera`].
    #[default]
    Perspective,
    /// Along the view's z axis: a view point `v` has the pixel coordinates `(fx v.x + cx, fy v.y + cy)`, so that
    /// `Camera::focal` is in pixels per world unit.
    Orthographic,
}

/// Vertical axis of a projection's normalised device coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipAxes {
    /// y points down: Vulkan with a viewport of positive height.
    YDown,
    /// y points up: OpenGL, Direct3D, WebGPU, Vulkan with a viewport of negative height.
    YUp,
}

/// Largest skew of a projection's axes, as a share of the focal length: rounding of matrices in single precision.
const SKEW_MAX: f64 = 1e-4;

impl Camera {
    /// Camera of a host's matrix from the world to clip space (projection · view, columns as of GLSL), for an image of
    /// so many pixels. Depth, near and far plane do not count, so that reversed and infinite projections will do; the
    /// axes of the view do not either. A jitter of the projection by whole or broken pixels moves the principal point.
    /// Of a product in single precision the camera has its rounding: multiply in double precision far from the origin.
    ///
    /// # Errors
    /// [`Error::Config`] for a matrix that is not finite or no perspective projection, mirrors, or skews the image.
    pub fn from_matrix(clip_from_world: &DMat4, [width, height]: [u32; 2], axes: ClipAxes) -> Result<Camera> {
        let refuse = |what: &str| Err(Error::Config(format!("a matrix to clip space that {what}")));
        let [x, y, w] = [0, 1, 3].map(|row| clip_from_world.row(row));
        if !clip_from_world.is_finite() || width == 0 || height == 0 {
            return refuse("is not finite, or an image without pixels");
        }
        let half = 0.5 * DVec2::new(width.into(), height.into());
        let y = if axes == ClipAxes::YDown { y } else { -y };
        // Rows of a matrix to pixels, up to a factor.
        let [across, down, ahead] = [half.x * (x + w), half.y * (y + w), w];
        let [u, v, n] = [across, down, ahead].map(|row| row.truncate());
        let scale = n.length();
        if scale < f64::MIN_POSITIVE {
            return refuse("is no perspective projection");
        }
        let forward = n / scale;
        let center = DVec2::new(u.dot(forward), v.dot(forward)) / scale;
        let (right, below) = (u / scale - center.x * forward, v / scale - center.y * forward);
        let focal = DVec2::new(right.length(), below.length());
        let skew = right.dot(below) / (focal.x * focal.y);
        if !(focal.min_element() > 0.0 && skew.abs() <= SKEW_MAX) {
            return refuse("skews the image");
        }
        let x_axis = right / focal.x;
        let y_axis = (below - below.dot(x_axis) * x_axis).normalize();
        let rotation = DMat3::from_cols(x_axis, y_axis, forward).transpose();
        if rotation.determinant() < 0.0 {
            return refuse("mirrors the image");
        }
        // The centre, which all three rows send to 0.
        let rows = DMat3::from_cols(u, v, n).transpose();
        let position = -(rows.inverse() * DVec3::new(across.w, down.w, ahead.w));
        match position.is_finite() && center.is_finite() {
            true => Ok(Camera {
                width,
                height,
                focal,
                center,
                rotation,
                position,
            }),
            false => refuse("is singular"),
        }
    }

    /// Camera of a host's orthographic matrix from the world to clip space (projection · view, columns as of GLSL,
    /// depth 0 to 1, reversed or not), for [`Projection::Orthographic`]. It lies on the plane of the nearest depth, in
    /// the middle of the image.
    ///
    /// # Errors
    /// [`Error::Config`] for a matrix that is not finite or no orthographic projection, or skews the image.
    pub fn from_orthographic(clip_from_world: &DMat4, [width, height]: [u32; 2], axes: ClipAxes) -> Result<Camera> {
        let refuse = |what: &str| Err(Error::Config(format!("a matrix to clip space that {what}")));
        let [x, y, z, w] = [0, 1, 2, 3].map(|row| clip_from_world.row(row));
        if !clip_from_world.is_finite() || width == 0 || height == 0 {
            return refuse("is not finite, or an image without pixels");
        }
        if w.truncate() != DVec3::ZERO || w.w <= 0.0 {
            return refuse("is no orthographic projection");
        }
        let half = 0.5 * DVec2::new(width.into(), height.into());
        let y = if axes == ClipAxes::YDown { y } else { -y };
        let [x, y, z] = [half.x * x, half.y * y, z].map(|row| row / w.w);
        let [right, below, depth] = [x, y, z].map(|row| row.truncate());
        let focal = DVec2::new(right.length(), below.length());
        let x_axis = right / focal.x;
        let y_axis = (below - below.dot(x_axis) * x_axis).normalize();
        let forward = x_axis.cross(y_axis);
        let along = depth.dot(forward);
        let skew = right.dot(below).abs() / (focal.x * focal.y);
        let lean = (depth - along * forward).length() / along.abs();
        if !(skew <= SKEW_MAX && lean <= SKEW_MAX) {
            return refuse("skews the image or its depth, or is singular");
        }
        // The nearest depth is 1 where depths are reversed.
        let nearest = if along > 0.0 { 0.0 } else { 1.0 };
        let rows = DMat3::from_cols(right, below, depth).transpose();
        Ok(Camera {
            width,
            height,
            focal,
            center: half,
            rotation: DMat3::from_cols(x_axis, y_axis, forward).transpose(),
            position: rows.inverse() * DVec3::new(-x.w, -y.w, nearest - z.w),
        })
    }

    /// The same view at another image size: intrinsics follow the rounded size per axis.
    pub fn resized(&self, width: u32, height: u32) -> Camera {
        let ratio = DVec2::new(
            f64::from(width) / f64::from(self.width),
            f64::from(height) / f64::from(self.height),
        );
        Camera {
            width,
            height,
            focal: self.focal * ratio,
            center: self.center * ratio,
            ..*self
        }
    }

    /// A view of the same vertical field at another image size: wider or narrower sizes show more or less at the sides.
    pub fn with_size(&self, width: u32, height: u32) -> Camera {
        let ratio = f64::from(height) / f64::from(self.height);
        let half = |width: u32, height: u32| 0.5 * DVec2::new(width.into(), height.into());
        Camera {
            width,
            height,
            focal: self.focal * ratio,
            center: half(width, height) + (self.center - half(self.width, self.height)) * ratio,
            ..*self
        }
    }

    /// View coordinates of a world point.
    pub fn view_from_world(&self, point: DVec3) -> DVec3 {
        self.rotation * (point - self.position)
    }

    /// Pixel coordinates of a point in view coordinates; of no meaning behind the camera.
    #[inline]
    pub(crate) fn pixel_from_view(&self, view: DVec3) -> DVec2 {
        self.focal * view.truncate() / view.z + self.center
    }

    /// Pixel coordinates of a world point in front of the camera, else `None`.
    pub fn pixel_from_world(&self, point: DVec3) -> Option<DVec2> {
        let v = self.view_from_world(point);
        (v.z > 0.0).then(|| self.pixel_from_view(v))
    }

    /// Whether a world point lies in the image. Occlusion is not considered.
    pub fn sees(&self, point: DVec3) -> bool {
        let is_inside = |x: f64, size: u32| (0.0..f64::from(size)).contains(&x);
        self.pixel_from_world(point)
            .is_some_and(|pixel| is_inside(pixel.x, self.width) && is_inside(pixel.y, self.height))
    }

    /// World direction (not normalised, view z = 1) of the ray through a pixel position.
    pub fn ray_from_pixel(&self, pixel: DVec2) -> DVec3 {
        let p = (pixel - self.center) / self.focal;
        self.rotation.transpose() * p.extend(1.0)
    }

    /// A camera at `position` looking at `target`; `up` is the world direction that appears upward.
    pub fn look_at(self, position: DVec3, target: DVec3, up: DVec3) -> Camera {
        let forward = (target - position).normalize();
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        Camera {
            rotation: DMat3::from_cols(right, down, forward).transpose(),
            position,
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec4};

    fn camera() -> Camera {
        Camera {
            width: 640,
            height: 360,
            focal: DVec2::new(500.0, 520.0),
            center: DVec2::new(310.5, 190.25),
            rotation: DMat3::from_quat(DQuat::from_xyzw(0.3, -0.2, 0.5, 0.8).normalize()),
            position: DVec3::new(0.5, -1.0, 2.0),
        }
    }

    /// Projection · view by the axes of the view (signs of y and z) and of clip space, reversed and infinite.
    fn matrix(camera: &Camera, sign: f64, axes: ClipAxes) -> DMat4 {
        let size = DVec2::new(camera.width.into(), camera.height.into());
        let mut view = DMat4::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, sign, sign)) * camera.rotation);
        view.w_axis = (view.transform_vector3(-camera.position)).extend(1.0);
        let down = if axes == ClipAxes::YDown { 1.0 } else { -1.0 };
        let focal = 2.0 * camera.focal / size;
        let center = 2.0 * camera.center / size - 1.0;
        let projection = DMat4::from_cols(
            DVec4::new(focal.x, 0.0, 0.0, 0.0),
            DVec4::new(0.0, sign * down * focal.y, 0.0, 0.0),
            DVec4::new(sign * center.x, sign * down * center.y, 0.0, sign),
            DVec4::new(0.0, 0.0, 0.1, 0.0),
        );
        projection * view
    }

    #[test]
    fn matrices_of_hosts_are_the_camera() {
        let camera = camera();
        for sign in [1.0, -1.0] {
            for axes in [ClipAxes::YDown, ClipAxes::YUp] {
                let found = Camera::from_matrix(&matrix(&camera, sign, axes), [640, 360], axes).unwrap();
                assert!(found.rotation.abs_diff_eq(camera.rotation, 1e-12), "{found:?}");
                assert!(found.position.distance(camera.position) < 1e-12, "{found:?}");
                let off = [found.focal - camera.focal, found.center - camera.center];
                assert!(off.iter().all(|off| off.length() < 1e-12 * 500.0), "{found:?}");
                // A jitter of one pixel to the right.
                let shift = DMat4::from_translation(DVec3::new(2.0 / 640.0, 0.0, 0.0));
                let moved = Camera::from_matrix(&(shift * matrix(&camera, sign, axes)), [640, 360], axes).unwrap();
                assert!((moved.center - camera.center - DVec2::X).length() < 1e-9, "{moved:?}");
                // A point has the same pixel by the matrix.
                let point = camera.position + camera.rotation.transpose() * DVec3::new(0.3, -0.2, 4.0);
                let clip = matrix(&camera, sign, axes) * point.extend(1.0);
                let down = if axes == ClipAxes::YDown { 1.0 } else { -1.0 };
                let pixel = DVec2::new(320.0, 180.0) * (1.0 + DVec2::new(clip.x, down * clip.y) / clip.w);
                let wanted = camera.pixel_from_world(point);
                assert!(clip.w > 0.0 && wanted.is_some_and(|wanted| wanted.distance(pixel) < 1e-9));
            }
        }
    }

    #[test]
    fn other_matrices_are_refused() {
        let good = matrix(&camera(), -1.0, ClipAxes::YUp);
        let refused = |matrix: DMat4, axes| Camera::from_matrix(&matrix, [640, 360], axes).unwrap_err().to_string();
        assert!(refused(good, ClipAxes::YDown).contains("mirrors"));
        assert!(refused(DMat4::ZERO, ClipAxes::YUp).contains("no perspective"));
        assert!(refused(DMat4::IDENTITY, ClipAxes::YUp).contains("no perspective"));
        assert!(refused(good * f64::NAN, ClipAxes::YUp).contains("not finite"));
        let mut skewed = DMat4::IDENTITY;
        skewed.y_axis.x = 0.1;
        assert!(refused(skewed * good, ClipAxes::YUp).contains("skews"));
        assert!(Camera::from_matrix(&good, [0, 360], ClipAxes::YUp).is_err());
    }

    #[test]
    fn orthographic_matrices_of_hosts_are_the_camera() {
        let camera = Camera {
            center: DVec2::new(320.0, 180.0),
            ..camera()
        };
        let (near, far) = (0.25, 8.0);
        for (sign, axes) in [(1.0, ClipAxes::YDown), (-1.0, ClipAxes::YUp), (-1.0, ClipAxes::YDown)] {
            for [at_near, at_far] in [[0.0, 1.0], [1.0, 0.0]] {
                let mut view = DMat4::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, sign, sign)) * camera.rotation);
                view.w_axis = (view.transform_vector3(-camera.position)).extend(1.0);
                let down = if axes == ClipAxes::YDown { sign } else { -sign };
                let slope = (at_far - at_near) / (far - near);
                let scale = 2.0 * camera.focal / DVec2::new(640.0, 360.0);
                let mut projection = DMat4::from_diagonal(DVec4::new(scale.x, down * scale.y, sign * slope, 1.0));
                projection.w_axis.z = at_near - slope * near;
                let found = Camera::from_orthographic(&(projection * view), [640, 360], axes).unwrap();
                assert!(found.rotation.abs_diff_eq(camera.rotation, 1e-12), "{found:?}");
                let place = camera.position + near * camera.rotation.row(2);
                assert!(found.position.distance(place) < 1e-12, "{found:?}");
                assert!((found.focal - camera.focal).length() < 1e-9 && found.center == camera.center);
                // A jitter of one pixel to the right moves the camera to the left.
                let shift = DMat4::from_translation(DVec3::new(2.0 / 640.0, 0.0, 0.0));
                let moved = Camera::from_orthographic(&(shift * projection * view), [640, 360], axes).unwrap();
                let left = moved.position + camera.rotation.row(0) / camera.focal.x;
                assert!(left.distance(place) < 1e-12, "{moved:?}");
            }
        }
        let refused = |matrix: DMat4| Camera::from_orthographic(&matrix, [640, 360], ClipAxes::YUp).unwrap_err();
        assert!(
            refused(matrix(&camera, 1.0, ClipAxes::YUp))
                .to_string()
                .contains("no orthographic")
        );
        assert!(
            refused(DMat4::from_scale(DVec3::new(1.0, 1.0, 0.0)))
                .to_string()
                .contains("singular")
        );
        let mut oblique = DMat4::IDENTITY;
        oblique.x_axis.z = 0.5;
        assert!(refused(oblique).to_string().contains("skews"));
        assert!(refused(oblique * f64::INFINITY).to_string().contains("not finite"));
    }

    #[test]
    fn another_size_keeps_the_vertical_field() {
        let wide = camera().with_size(1000, 180);
        assert_eq!(
            (wide.focal, wide.center),
            (DVec2::new(250.0, 260.0), DVec2::new(495.25, 95.125))
        );
        assert_eq!(camera().with_size(640, 360), camera());
    }
}
