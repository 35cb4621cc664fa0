//! Ray and its intersection with a surface.

use glam::DVec3;

/// Half line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    /// Start.
    pub(super) origin: DVec3,
    /// Direction; not normalised: distances along a ray are in units of its length.
    pub(super) direction: DVec3,
}

impl Ray {
    /// The point at distance `t`.
    pub(super) fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// Intersection of a ray with a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Distance along the ray.
    pub(super) t: f64,
    /// Unit geometric normal, outward.
    pub(super) normal: DVec3,
    /// Unit shading normal, interpolated in meshes.
    pub(super) shading_normal: DVec3,
}

impl Hit {
    pub(super) fn new(t: f64, normal: DVec3) -> Hit {
        Hit {
            t,
            normal,
            shading_normal: normal,
        }
    }
}
