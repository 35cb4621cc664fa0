//! Shapes in local coordinates and their intersections with rays.

use super::mesh::MeshTree;
use super::ray::{Hit, Ray};
use glam::{DVec2, DVec3, Vec3Swizzles};

/// A shape around its own origin.
#[derive(Clone, Debug)]
pub enum Shape {
    /// The part of the plane z = 0 with |x| and |y| within these half sizes; seen from both sides.
    Rectangle(DVec2),
    /// The part of the plane z = 0 within this radius; seen from both sides.
    Disc(f64),
    /// A sphere of this radius.
    Sphere(f64),
    /// A box with these half sizes.
    Cuboid(DVec3),
    /// A closed cylinder around z.
    Cylinder {
        /// Its radius.
        radius: f64,
        /// Its half height.
        half_height: f64,
    },
    /// Triangles.
    Mesh(MeshTree),
}

impl Shape {
    /// Nearest hit of the ray with a distance in `t_min..t_max`.
    pub(super) fn hit(&self, ray: &Ray, t_min: f64, t_max: f64) -> Option<Hit> {
        let inside = |t: f64| t > t_min && t < t_max;
        match self {
            Shape::Rectangle(half) => {
                plane(ray, 0.0, DVec3::Z).filter(|hit| inside(hit.t) && ray.at(hit.t).xy().abs().cmple(*half).all())
            }
            Shape::Disc(radius) => {
                plane(ray, 0.0, DVec3::Z).filter(|hit| inside(hit.t) && ray.at(hit.t).xy().length() <= *radius)
            }
            Shape::Sphere(radius) => {
                let roots = round(ray.origin, ray.direction, *radius)?;
                let t = roots.into_iter().find(|&t| inside(t))?;
                Some(Hit::new(t, ray.at(t) / *radius))
            }
            Shape::Cuboid(half) => cuboid(ray, *half, inside),
            Shape::Cylinder { radius, half_height } => cylinder(ray, *radius, *half_height, inside),
            Shape::Mesh(tree) => tree.hit(ray, t_min, t_max),
        }
    }

    /// Radius of the bounding sphere around the origin.
    pub(super) fn bounding_radius(&self) -> f64 {
        match self {
            Shape::Rectangle(half) => half.length(),
            Shape::Disc(radius) | Shape::Sphere(radius) => *radius,
            Shape::Cuboid(half) => half.length(),
            Shape::Cylinder { radius, half_height } => radius.hypot(*half_height),
            Shape::Mesh(tree) => tree.bounding_radius,
        }
    }
}

/// The plane z = `height`.
fn plane(ray: &Ray, height: f64, normal: DVec3) -> Option<Hit> {
    let t = (height - ray.origin.z) / ray.direction.z;
    t.is_finite().then(|| Hit::new(t, normal))
}

/// Solutions t of |origin + t direction| = radius, ascending. Accurate for distant origins too, as the nearer root is
/// not a difference of large numbers (Haines et al., Ray Tracing Gems, chapter 7).
fn round(origin: DVec3, direction: DVec3, radius: f64) -> Option<[f64; 2]> {
    let a = direction.length_squared();
    let b = -origin.dot(direction);
    let nearest = origin + (b / a) * direction;
    let discriminant = a * (radius * radius - nearest.length_squared());
    if a == 0.0 || discriminant < 0.0 {
        return None;
    }
    let q = b + discriminant.sqrt().copysign(b);
    let c = origin.length_squared() - radius * radius;
    let (t0, t1) = (c / q, q / a);
    Some([t0.min(t1), t0.max(t1)])
}

fn cuboid(ray: &Ray, half: DVec3, inside: impl Fn(f64) -> bool) -> Option<Hit> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut enter_axis, mut leave_axis) = (0, 0);
    for axis in 0..3 {
        let (o, d, h) = (ray.origin[axis], ray.direction[axis], half[axis]);
        if d == 0.0 {
            if o.abs() > h {
                return None;
            }
            continue;
        }
        let (t0, t1) = ((-h - o) / d, (h - o) / d);
        if t0.min(t1) > enter {
            (enter, enter_axis) = (t0.min(t1), axis);
        }
        if t0.max(t1) < leave {
            (leave, leave_axis) = (t0.max(t1), axis);
        }
    }
    if enter > leave {
        return None;
    }
    let (t, axis) = [(enter, enter_axis), (leave, leave_axis)]
        .into_iter()
        .find(|&(t, _)| inside(t))?;
    let mut normal = DVec3::ZERO;
    normal[axis] = 1.0_f64.copysign(ray.at(t)[axis]);
    Some(Hit::new(t, normal))
}

fn cylinder(ray: &Ray, radius: f64, half_height: f64, inside: impl Fn(f64) -> bool) -> Option<Hit> {
    let flat = |v: DVec3| v.with_z(0.0);
    let side = round(flat(ray.origin), flat(ray.direction), radius)
        .into_iter()
        .flatten()
        .map(|t| Hit::new(t, flat(ray.at(t)) / radius))
        .filter(|hit| ray.at(hit.t).z.abs() <= half_height);
    let caps = [1.0, -1.0]
        .into_iter()
        .filter_map(|sign| plane(ray, sign * half_height, sign * DVec3::Z))
        .filter(|hit| ray.at(hit.t).xy().length() <= radius);
    side.chain(caps)
        .filter(|hit| inside(hit.t))
        .min_by(|a, b| a.t.total_cmp(&b.t))
}
