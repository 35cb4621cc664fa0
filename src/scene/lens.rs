//! Lenses: where the light of a direction falls on the sensor.
//!
//! The models are those of COLMAP 4.1 (`src/colmap/sensor/models.h`) and of photogrammetry, all in the forward
//! direction, which is all that a pinhole picture needs of them: each of its pixels is a direction, looked up in the
//! photograph. Coordinates on the sensor are in focal lengths from the principal point.

use super::Camera;
use glam::{DMat3, DVec2, DVec3};

/// Distortion of a perspective lens, OpenCV's radial–tangential model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial, second order.
    pub k1: f64,
    /// Radial, fourth order.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
}

/// Model of a lens with its coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// Perspective with radial–tangential distortion (SIMPLE_RADIAL, RADIAL, OPENCV).
    Brown(Distortion),
    /// The same with a rational radial term (FULL_OPENCV).
    Rational {
        /// k1 to k6; the last three are of the denominator.
        radial: [f64; 6],
        /// p1, p2.
        tangential: [f64; 2],
    },
    /// Photogrammetric model: a radial polynomial of fourth degree in the squared radius, and axes at an angle.
    Polynomial {
        /// The radius is the angle from the axis, else its tangent.
        is_angular: bool,
        /// k1 to k4.
        radial: [f64; 4],
        /// p1, p2, in OpenCV's order.
        tangential: [f64; 2],
        /// Share of y that is added to x.
        shear: f64,
    },
    /// Field-of-view model (FOV), its angle ω in radians.
    FieldOfView(f64),
    /// Angle times a polynomial of its square (the fisheye models of OpenCV; Kannala and Brandt 2006).
    Fisheye([f64; 4]),
    /// Fisheye with tangential and thin-prism distortion (THIN_PRISM_FISHEYE).
    ThinPrism {
        /// k1 to k4.
        radial: [f64; 4],
        /// p1, p2.
        tangential: [f64; 2],
        /// sx1, sy1.
        prism: [f64; 2],
    },
    /// The same with six radial and four prism terms (RAD_TAN_THIN_PRISM_FISHEYE).
    RadTanThinPrism {
        /// k0 to k5.
        radial: [f64; 6],
        /// p0, p1.
        tangential: [f64; 2],
        /// s0 to s3.
        prism: [f64; 4],
    },
    /// Division model (SIMPLE_DIVISION, DIVISION).
    Division(f64),
    /// Extended unified model (EUCM): α, β.
    Unified([f64; 2]),
    /// Longitude and latitude (EQUIRECTANGULAR), in radians.
    Equirectangular,
}

impl Lens {
    /// Place of a direction (x right, y down, z forward, of any length) on the sensor; `None` if the model has none.
    /// Folds are not looked for.
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        let flat = direction.truncate();
        let plane = (direction.z > 0.0).then(|| flat / direction.z);
        match *self {
            Lens::Brown(Distortion { k1, k2, p1, p2 }) => plane.map(|p| {
                let r2 = p.length_squared();
                let radial = 1.0 + r2 * (k1 + r2 * k2);
                p * radial + tangent(p, [p1, p2])
            }),
            Lens::Rational { radial, tangential } => plane.map(|p| {
                let [k1, k2, k3, k4, k5, k6] = radial;
                let s = p.length_squared();
                let ratio = polynomial(s, &[1.0, k1, k2, k3]) / polynomial(s, &[1.0, k4, k5, k6]);
                p * ratio + tangent(p, tangential)
            }),
            Lens::Polynomial {
                is_angular,
                radial: [k1, k2, k3, k4],
                tangential,
                shear,
            } => {
                let p = if is_angular { angular(direction) } else { plane }?;
                let radial = polynomial(p.length_squared(), &[1.0, k1, k2, k3, k4]);
                let at = p * radial + tangent(p, tangential);
                Some(DVec2::new(at.x + shear * at.y, at.y))
            }
            Lens::FieldOfView(omega) => plane.map(|p| p * field_of_view(p.length(), omega)),
            Lens::Fisheye([k1, k2, k3, k4]) => {
                let angle = angular(direction)?;
                Some(angle * polynomial(angle.length_squared(), &[1.0, k1, k2, k3, k4]))
            }
            Lens::ThinPrism {
                radial: [k1, k2, k3, k4],
                tangential,
                prism,
            } => {
                let p = angular(direction)?;
                let s = p.length_squared();
                let radial = polynomial(s, &[1.0, k1, k2, k3, k4]);
                Some(p * radial + tangent(p, tangential) + s * DVec2::from(prism))
            }
            Lens::RadTanThinPrism {
                radial: [k0, k1, k2, k3, k4, k5],
                tangential: [p0, p1],
                prism: [s0, s1, s2, s3],
            } => {
                let angle = angular(direction)?;
                let p = angle * polynomial(angle.length_squared(), &[1.0, k0, k1, k2, k3, k4, k5]);
                let s = p.length_squared();
                let tangent = p * (2.0 * (p.x * p0 + p.y * p1)) + s * DVec2::new(p0, p1);
                Some(p + tangent + s * DVec2::new(s0 + s * s1, s2 + s * s3))
            }
            Lens::Division(k) => {
                let (z, rho2) = (direction.z, flat.length_squared());
                let discriminant = z * z - 4.0 * rho2 * k;
                let divisor = z + discriminant.sqrt();
                (discriminant >= 0.0 && divisor > 0.0).then(|| 2.0 * flat / divisor)
            }
            Lens::Unified([alpha, beta]) => {
                let length = (beta * flat.length_squared() + direction.z * direction.z).sqrt();
                let divisor = alpha * length + (1.0 - alpha) * direction.z;
                (divisor > 1e-12 * length).then(|| flat / divisor)
            }
            Lens::Equirectangular => {
                let level = direction.x.hypot(direction.z);
                (direction != DVec3::ZERO).then(|| DVec2::new(direction.x.atan2(direction.z), direction.y.atan2(level)))
            }
        }
    }

    /// The smallest model that gives the same: FULL_OPENCV with a zero tail, as several programs write it, is OPENCV.
    pub fn simplified(self) -> Lens {
        match self {
            Lens::Rational {
                radial: [k1, k2, 0.0, 0.0, 0.0, 0.0],
                tangential: [p1, p2],
            } => Lens::Brown(Distortion { k1, k2, p1, p2 }),
            Lens::ThinPrism {
                radial,
                tangential: [0.0, 0.0],
                prism: [0.0, 0.0],
            } => Lens::Fisheye(radial),
            Lens::Polynomial {
                is_angular: false,
                radial: [k1, k2, k3, 0.0],
                tangential,
                shear: 0.0,
            } => {
                let radial = [k1, k2, k3, 0.0, 0.0, 0.0];
                Lens::Rational { radial, tangential }.simplified()
            }
            Lens::Polynomial {
                is_angular: true,
                radial,
                tangential,
                shear: 0.0,
            } => {
                let prism = [0.0; 2];
                Lens::ThinPrism {
                    radial,
                    tangential,
                    prism,
                }
                .simplified()
            }
            other => other,
        }
    }

    /// True if the photograph is that of a pinhole already.
    pub fn is_none(&self) -> bool {
        match *self {
            Lens::Brown(distortion) => distortion == Distortion::default(),
            Lens::Division(k) => k == 0.0,
            _ => false,
        }
    }

    /// Largest angle from the axis, in radians, up to which the distance from the principal point grows in every
    /// direction. Beyond it the model folds back, and pixels would be seen twice.
    pub fn reach(&self) -> f64 {
        if let Lens::Brown(distortion) = self {
            return fold(distortion).sqrt().atan();
        }
        if *self == Lens::Equirectangular {
            return std::f64::consts::PI;
        }
        let azimuths = (0..AZIMUTHS).map(|i| DVec2::from_angle(i as f64 * std::f64::consts::TAU / AZIMUTHS as f64));
        let reaches = azimuths.map(|toward| {
            let mut last = 0.0;
            for step in 1..=ANGLES {
                let angle = step as f64 * std::f64::consts::PI / ANGLES as f64;
                let place = self.project((angle.sin() * toward).extend(angle.cos()));
                match place.map(|place| place.dot(toward)) {
                    Some(distance) if distance > last => last = distance,
                    _ => return (step - 1) as f64 * std::f64::consts::PI / ANGLES as f64,
                }
            }
            std::f64::consts::PI
        });
        reaches.fold(std::f64::consts::PI, f64::min)
    }
}

/// Directions and steps of the search for a fold: a tenth of a degree.
const AZIMUTHS: usize = 16;
const ANGLES: usize = 1800;

/// Angle from the axis, in the direction of the point; `None` behind, where there is no direction.
fn angular(direction: DVec3) -> Option<DVec2> {
    let flat = direction.truncate();
    let rho = flat.length();
    match rho > 0.0 {
        true => Some(flat * (rho.atan2(direction.z) / rho)),
        false => (direction.z > 0.0).then_some(DVec2::ZERO),
    }
}

/// Factor of a radius by the field-of-view model.
fn field_of_view(r: f64, omega: f64) -> f64 {
    match r * omega.abs() < 1e-9 {
        true if omega.abs() < 1e-9 => 1.0,
        true => 2.0 * (0.5 * omega).tan() / omega,
        false => (2.0 * r * (0.5 * omega).tan()).atan() / (omega * r),
    }
}

fn tangent(p: DVec2, [p1, p2]: [f64; 2]) -> DVec2 {
    let (s, xy) = (p.length_squared(), 2.0 * p.x * p.y);
    DVec2::new(
        p1 * xy + p2 * (s + 2.0 * p.x * p.x),
        p2 * xy + p1 * (s + 2.0 * p.y * p.y),
    )
}

/// Σ coefficients\[i\] sⁱ.
fn polynomial(s: f64, coefficients: &[f64]) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, k| sum * s + k)
}

/// The squared radius up to which r (1 + k1 r² + k2 r⁴) grows: the first positive root of its derivative
/// 1 + 3 k1 s + 5 k2 s² in s = r².
fn fold(distortion: &Distortion) -> f64 {
    let (a, b) = (5.0 * distortion.k2, 3.0 * distortion.k1);
    let discriminant = b * b - 4.0 * a;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    // Roots of a s² + b s + 1 as 2 / (-b ∓ √…), exact for a = 0, too.
    let root = discriminant.sqrt();
    [2.0 / (-b - root), 2.0 / (-b + root)]
        .into_iter()
        .filter(|s| *s > 0.0)
        .fold(f64::INFINITY, f64::min)
}

/// Camera that took a photograph, and the pinhole picture wanted of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// The lens.
    pub lens: Lens,
    /// Width and height of the photograph in pixels.
    pub size: [u32; 2],
    /// Focal lengths in pixels.
    pub focal: DVec2,
    /// Principal point in pixels.
    pub center: DVec2,
    /// Directions of the lens from those of the pinhole: identity, but for the sides of a wide photograph.
    pub lens_from_pinhole: DMat3,
    /// The pinhole at full size; its pose is not used.
    pub pinhole: Camera,
}

impl Optics {
    /// A photograph by `camera` through a lens, seen as a pinhole of the same size and intrinsics.
    pub fn of(lens: Lens, camera: &Camera) -> Optics {
        Optics {
            lens,
            size: [camera.width, camera.height],
            focal: camera.focal,
            center: camera.center,
            lens_from_pinhole: DMat3::IDENTITY,
            pinhole: *camera,
        }
    }

    /// Whether the picture is a side of a photograph that was split, and not the whole.
    pub fn is_side(&self) -> bool {
        [self.pinhole.width, self.pinhole.height] != self.size
            || self.pinhole.center != self.center
            || self.lens_from_pinhole != DMat3::IDENTITY
    }

    /// Pixel of the photograph under a direction of the pinhole; `None` outside of the photograph or beyond `reach`,
    /// the largest angle of the lens.
    pub fn pixel(&self, direction: DVec3, reach: f64) -> Option<DVec2> {
        let direction = self.lens_from_pinhole * direction;
        let angle = direction.truncate().length().atan2(direction.z);
        if angle >= reach {
            return None;
        }
        let pixel = self.lens.project(direction)? * self.focal + self.center;
        let size = DVec2::new(self.size[0].into(), self.size[1].into());
        (pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all()).then_some(pixel)
    }

    /// The same for a photograph of another size.
    pub fn resized(&self, width: u32, height: u32) -> Optics {
        let ratio = DVec2::new(
            f64::from(width) / f64::from(self.size[0]),
            f64::from(height) / f64::from(self.size[1]),
        );
        let scaled = |side: u32, ratio: f64| (f64::from(side) * ratio).round().max(1.0) as u32;
        let pinhole = &self.pinhole;
        Optics {
            size: [width, height],
            focal: self.focal * ratio,
            center: self.center * ratio,
            pinhole: pinhole.resized(scaled(pinhole.width, ratio.x), scaled(pinhole.height, ratio.y)),
            ..*self
        }
    }
}
