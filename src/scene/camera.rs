//! A pinhole camera: intrinsics in pixels, pose in the world.

use glam::{DMat3, DVec2, DVec3};

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

impl Camera {
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

    /// Pixel coordinates of a world point in front of the camera, else `None`.
    pub fn pixel_from_world(&self, point: DVec3) -> Option<DVec2> {
        let v = self.view_from_world(point);
        (v.z > 0.0).then(|| self.focal * v.truncate() / v.z + self.center)
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
