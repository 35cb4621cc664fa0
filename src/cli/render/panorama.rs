//! Equirectangular pictures of the whole sphere around a camera, from pinhole pictures of its parts.
//!
//! Four parts of each side of a cube are drawn, each by a camera that looks at its middle: projection is linear at the
//! mean of a splat, and the narrower a part, the less pictures of neighbouring parts differ at their border. Splats are
//! in the order of distance, which is the same for all parts.
//!
//! Column x of `width` is at the longitude (x + ½) / width · 360° − 180° from the camera's axis, to the right; row y of
//! `height` at the latitude 90° − (y + ½) / height · 180°.

use crate::Result;
use crate::render::RenderedImage;
use crate::scene::Camera;
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Parts of a side of the cube along each axis.
const DIVISION: u32 = 2;

/// Sides of the cube: axes x (right), y (down) and z (ahead) in those of the camera.
const SIDES: [[DVec3; 3]; 6] = [
    [DVec3::X, DVec3::Y, DVec3::Z],
    [DVec3::NEG_Z, DVec3::Y, DVec3::X],
    [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z],
    [DVec3::Z, DVec3::Y, DVec3::NEG_X],
    [DVec3::X, DVec3::Z, DVec3::NEG_Y],
    [DVec3::X, DVec3::NEG_Z, DVec3::Y],
];

/// Place of a pixel of the panorama in the picture of a part, pixels.
#[derive(Clone, Copy, Debug)]
struct PartPlace {
    part: u32,
    at: [f32; 2],
}

/// Layout of the panoramas of one size.
pub(super) struct Panorama {
    width: u32,
    height: u32,
    /// Cameras of the parts at the origin, `rotation` from the camera's axes.
    parts: Vec<Camera>,
    places: Vec<PartPlace>,
}

impl Panorama {
    pub(super) fn new([width, height]: [u32; 2]) -> Panorama {
        // Pixels of the part are as wide as those of the panorama at its equator.
        let focal = f64::from(width.max(2 * height)) / TAU;
        let parts: Vec<Camera> = (0..6 * DIVISION * DIVISION)
            .map(|part| camera_of(part, focal))
            .collect();
        let place = |i: usize| {
            let (column, row) = (i as u32 % width, i as u32 / width);
            let direction = direction([width, height], DVec2::new(column.into(), row.into()) + 0.5);
            let part = part_of(direction);
            // A direction lies in its part, ahead of that camera.
            let at = parts[part as usize].pixel_from_world(direction).unwrap_or_default();
            PartPlace {
                part,
                at: at.as_vec2().to_array(),
            }
        };
        let count = width as usize * height as usize;
        Panorama {
            width,
            height,
            places: (0..count).into_par_iter().map(place).collect(),
            parts,
        }
    }

    /// Width and height in pixels.
    pub(super) fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// The panorama of a camera, of which place and axes count.
    pub(super) fn draw(
        &self,
        camera: &Camera,
        mut draw: impl FnMut(&Camera) -> Result<RenderedImage>,
    ) -> Result<RenderedImage> {
        let of_part = |part: &Camera| {
            draw(&Camera {
                rotation: part.rotation * camera.rotation,
                position: camera.position,
                ..*part
            })
        };
        let pictures: Vec<RenderedImage> = self.parts.iter().map(of_part).collect::<Result<_>>()?;
        let pixel = |place: &PartPlace| {
            let picture = &pictures[place.part as usize];
            let corners = corners(picture, place.at);
            let mix = |of: &dyn Fn(usize) -> f32| corners.iter().map(|&(i, weight)| weight * of(i)).sum::<f32>();
            let rgb = [0, 1, 2].map(|channel| mix(&|i| picture.rgb[i][channel]));
            (rgb, mix(&|i| picture.transmittance[i]))
        };
        let (rgb, transmittance) = self.places.par_iter().map(pixel).unzip();
        Ok(RenderedImage {
            width: self.width,
            height: self.height,
            rgb,
            transmittance,
            depth: Vec::new(),
            ids: Vec::new(),
            id_depth: Vec::new(),
            surface: None,
        })
    }
}

/// Direction of a place in the panorama, pixels, in the camera's axes.
fn direction([width, height]: [u32; 2], at: DVec2) -> DVec3 {
    let longitude = (at.x / f64::from(width) - 0.5) * TAU;
    let latitude = (0.5 - at.y / f64::from(height)) * PI;
    let ahead = latitude.cos();
    DVec3::new(ahead * longitude.sin(), -latitude.sin(), ahead * longitude.cos())
}

/// The part that shows a direction.
fn part_of(direction: DVec3) -> u32 {
    let along = |side: &[DVec3; 3]| direction.dot(side[2]);
    let side = (0..SIDES.len()).max_by(|&a, &b| along(&SIDES[a]).total_cmp(&along(&SIDES[b])));
    let side = side.unwrap_or(0);
    let place = |axis: usize| {
        let share = 0.5 + 0.5 * direction.dot(SIDES[side][axis]) / along(&SIDES[side]);
        // The cast saturates.
        ((share * f64::from(DIVISION)) as u32).min(DIVISION - 1)
    };
    (side as u32 * DIVISION + place(1)) * DIVISION + place(0)
}

/// Camera of a part at the origin, with its field and two pixels around it.
fn camera_of(part: u32, focal: f64) -> Camera {
    let axes = &SIDES[(part / (DIVISION * DIVISION)) as usize];
    let place = |step: u32, share: f64| 2.0 * (f64::from(step) + share) / f64::from(DIVISION) - 1.0;
    let at = |x: f64, y: f64| {
        let (x, y) = (place(part % DIVISION, x), place(part / DIVISION % DIVISION, y));
        axes[0] * x + axes[1] * y + axes[2]
    };
    let toward = |size: u32| Camera {
        width: size,
        height: size,
        focal: DVec2::splat(focal),
        center: DVec2::splat(f64::from(size) / 2.0),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    };
    let camera = toward(1).look_at(DVec3::ZERO, at(0.5, 0.5), -axes[1]);
    let reach = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].map(|(x, y)| {
        let v = camera.view_from_world(at(x, y));
        (v.truncate() / v.z).abs().max_element()
    });
    let reach = reach.into_iter().fold(0.0, f64::max);
    let size = 2 * (focal * reach + 2.0).ceil() as u32;
    Camera {
        rotation: camera.rotation,
        ..toward(size)
    }
}

/// The four pixels about a place and their shares of a bilinear mixture.
fn corners(picture: &RenderedImage, [x, y]: [f32; 2]) -> [(usize, f32); 4] {
    let along = |at: f32, side: u32| {
        let at = (at - 0.5).clamp(0.0, (side - 1) as f32);
        let first = (at as u32).min(side.saturating_sub(2));
        (first as usize, (at - first as f32).min(1.0))
    };
    let ((column, right), (row, down)) = (along(x, picture.width), along(y, picture.height));
    let at = |dx: usize, dy: usize| (row + dy) * picture.width as usize + column + dx;
    [
        (at(0, 0), (1.0 - right) * (1.0 - down)),
        (at(1, 0), right * (1.0 - down)),
        (at(0, 1), (1.0 - right) * down),
        (at(1, 1), right * down),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pictures of the directions themselves, as colours.
    fn directions(camera: &Camera) -> RenderedImage {
        let ray = |i: u32| {
            let at = DVec2::new((i % camera.width).into(), (i / camera.width).into()) + 0.5;
            camera.ray_from_pixel(at).normalize()
        };
        let rays: Vec<DVec3> = (0..camera.width * camera.height).map(ray).collect();
        RenderedImage {
            width: camera.width,
            height: camera.height,
            rgb: rays.iter().map(|ray| ray.as_vec3().to_array()).collect(),
            transmittance: rays.iter().map(|ray| ray.y as f32).collect(),
            depth: Vec::new(),
            ids: Vec::new(),
            id_depth: Vec::new(),
            surface: None,
        }
    }

    #[test]
    fn every_pixel_shows_its_direction() {
        let camera = Camera {
            width: 8,
            height: 6,
            focal: DVec2::ONE,
            center: DVec2::ONE,
            rotation: DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(0.3),
            position: DVec3::ONE,
        };
        for size in [[128, 64], [100, 30], [31, 57]] {
            let picture = Panorama::new(size).draw(&camera, |part| Ok(directions(part))).unwrap();
            assert_eq!([picture.width, picture.height], size);
            // Half a pixel of curvature: of a chord of one pixel, its square over eight.
            let step = TAU / f64::from(size[0].max(2 * size[1]));
            for (i, rgb) in picture.rgb.iter().enumerate() {
                let at = DVec2::new((i as u32 % size[0]).into(), (i as u32 / size[0]).into()) + 0.5;
                let wanted = camera.rotation.transpose() * direction(size, at);
                let found = DVec3::from(rgb.map(f64::from));
                assert!(
                    found.distance(wanted) <= step * step / 4.0 + 1e-5,
                    "{size:?}, {i}: {found}"
                );
                assert!((f64::from(picture.transmittance[i]) - found.y).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_middle_is_ahead_and_the_right_is_right() {
        let size = [360, 180];
        assert!(direction(size, DVec2::new(180.0, 90.0)).distance(DVec3::Z) < 1e-12);
        assert!(direction(size, DVec2::new(270.0, 90.0)).distance(DVec3::X) < 1e-12);
        assert!(direction(size, DVec2::new(180.0, 0.0)).distance(DVec3::NEG_Y) < 1e-12);
    }
}
