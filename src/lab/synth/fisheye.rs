//! Photographs through a fisheye lens, ray by ray.

use super::Scene;
use crate::scene::{Camera, Photo};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Angle from the axis to the rim of the picture, degrees.
const HALF_FIELD_DEGREES: f64 = 80.0;

/// Coefficients of Kannala and Brandt's model, OPENCV_FISHEYE.
const RADIAL: [f64; 4] = [-0.02, 0.004, -0.001, 0.0];

/// Fisheye camera with a square sensor, which the circle of its picture touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FisheyeLens {
    /// Width and height of the sensor, pixels.
    pub side: u32,
    /// Focal length, pixels.
    pub focal: f64,
    /// Coefficients k1 to k4.
    pub radial: [f64; 4],
}

impl FisheyeLens {
    /// Lens of 160° for photographs of about so many pixels.
    pub fn of(pixels: u32) -> FisheyeLens {
        let pixels = f64::from(pixels);
        let side = pixels.sqrt().round().max(1.0);
        FisheyeLens {
            side: side as u32,
            focal: 0.5 * side / distorted(HALF_FIELD_DEGREES.to_radians()).0,
            radial: RADIAL,
        }
    }

    /// Direction in the axes of the camera of a place on the sensor; `None` beyond the rim.
    pub fn direction(&self, pixel: DVec2) -> Option<DVec3> {
        let offset = (pixel - 0.5 * f64::from(self.side)) / self.focal;
        let radius = offset.length();
        let rim = HALF_FIELD_DEGREES.to_radians();
        if radius > distorted(rim).0 {
            return None;
        }
        // Newton's method; the model is nearly linear up to the rim.
        let mut angle = radius;
        for _ in 0..20 {
            let (value, slope) = distorted(angle);
            angle -= (value - radius) / slope;
        }
        let aside = if radius > 0.0 { offset / radius } else { DVec2::X };
        Some((angle.sin() * aside).extend(angle.cos()))
    }
}

/// Distance from the middle of the picture in focal lengths, at an angle from the axis, and its slope.
fn distorted(angle: f64) -> (f64, f64) {
    let square = angle * angle;
    let (mut value, mut slope, mut power) = (1.0, 1.0, 1.0);
    for (k, coefficient) in RADIAL.iter().enumerate() {
        power *= square;
        value += coefficient * power;
        slope += (2 * k + 3) as f64 * coefficient * power;
    }
    (angle * value, slope)
}

impl Scene {
    /// Photograph from the pose of a camera through a fisheye lens: each pixel the mean of `samples` × `samples` rays,
    /// transparent beyond the rim.
    pub fn fisheye_photo(&self, camera: &Camera, lens: &FisheyeLens, samples: u32) -> Photo {
        let step = 1.0 / f64::from(samples);
        let world = |direction: DVec3| camera.rotation.transpose() * direction;
        let pixel = |index: u32| {
            let corner = DVec2::new((index % lens.side).into(), (index / lens.side).into());
            let mut sum = DVec3::ZERO;
            for i in 0..samples * samples {
                let offset = DVec2::new((i % samples).into(), (i / samples).into()) + 0.5;
                let Some(direction) = lens.direction(corner + step * offset) else {
                    return [0; 4];
                };
                let ray = super::Ray {
                    origin: camera.position,
                    direction: world(direction),
                };
                sum += self.color(&ray).unwrap_or_default();
            }
            let [r, g, b] = (sum * step * step).as_vec3().to_array().map(Photo::level);
            [r, g, b, 255]
        };
        Photo {
            width: lens.side,
            height: lens.side,
            rgba: (0..lens.side * lens.side).into_par_iter().map(pixel).collect(),
        }
    }
}
