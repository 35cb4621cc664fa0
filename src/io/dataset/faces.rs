//! Wide photographs as several pinhole pictures: the sides of a cube about the camera, each cropped to the light that
//! the lens sees.

use crate::scene::{Camera, Lens, Optics};
use glam::{DMat3, DVec2, DVec3};

/// Field of view in degrees, across or down, up to which one pinhole picture is made.
const FIELD_MAX_DEGREES: f64 = 100.0;

/// Pixels by which neighbouring pictures overlap on each side: the reach of SSIM's window.
const OVERLAP: f64 = 5.0;

/// Least share of the photograph's pixels that a picture holds; smaller slivers are left out.
const SHARE_MIN: f64 = 0.04;

/// Distance of the pixels looked at to find the extent of a picture.
const STRIDE: usize = 4;

/// Names of the sides in the order of their names, with the axes x, y and z of the picture in those of the lens.
const SIDES: [(&str, [DVec3; 3]); 6] = [
    ("back", [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z]),
    ("down", [DVec3::X, DVec3::NEG_Z, DVec3::Y]),
    ("front", [DVec3::X, DVec3::Y, DVec3::Z]),
    ("left", [DVec3::Z, DVec3::Y, DVec3::NEG_X]),
    ("right", [DVec3::NEG_Z, DVec3::Y, DVec3::X]),
    ("up", [DVec3::X, DVec3::Z, DVec3::NEG_Y]),
];

/// Sides of a photograph with their names; `None` if one pinhole picture shows it all. The pinholes of the result have
/// no pose.
pub(super) fn split(optics: &Optics) -> Option<Vec<(&'static str, Optics)>> {
    if matches!(optics.lens, Lens::Brown(_)) {
        return None;
    }
    let reach = optics.lens.reach();
    let half = |toward: DVec2| half_field(optics, toward, reach);
    let across = half(DVec2::X) + half(DVec2::NEG_X);
    let down = half(DVec2::Y) + half(DVec2::NEG_Y);
    if across.max(down) <= FIELD_MAX_DEGREES {
        return None;
    }
    let sides = SIDES.iter().filter_map(|(name, axes)| {
        let [x, y, z] = *axes;
        Some((*name, side(optics, DMat3::from_cols(x, y, z), reach)?))
    });
    Some(sides.collect())
}

/// Whether no pixel of a picture has light, judged by some of them.
pub(super) fn shows_nothing(optics: &Optics) -> bool {
    let Camera {
        width,
        height,
        focal,
        center,
        ..
    } = optics.pinhole;
    let reach = optics.lens.reach();
    let rows = (0..height).step_by(STRIDE);
    let mut places = rows.flat_map(|y| (0..width).step_by(STRIDE).map(move |x| (x, y)));
    !places.any(|(x, y)| {
        let place = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        optics.pixel(((place - center) / focal).extend(1.0), reach).is_some()
    })
}

/// Degrees from the axis to the border of the photograph, or to the fold of the lens.
fn half_field(optics: &Optics, toward: DVec2, reach: f64) -> f64 {
    let degrees = (1..=1800).map(|step| 0.1 * f64::from(step));
    let is_seen = |degrees: &f64| {
        let angle = degrees.to_radians();
        let direction = (angle.sin() * toward).extend(angle.cos());
        optics.pixel(direction, reach).is_some()
    };
    degrees.take_while(is_seen).last().unwrap_or(0.0)
}

/// A side of the cube, cropped; `None` if the lens sees too little of it.
fn side(optics: &Optics, lens_from_pinhole: DMat3, reach: f64) -> Option<Optics> {
    let half = optics.focal + OVERLAP;
    let size = (2.0 * half).ceil().as_uvec2();
    let whole = Camera {
        width: size.x,
        height: size.y,
        focal: optics.focal,
        center: size.as_dvec2() / 2.0,
        ..optics.pinhole
    };
    let candidate = Optics {
        lens_from_pinhole,
        pinhole: whole,
        ..*optics
    };
    let (mut low, mut high, mut seen) = (size, glam::UVec2::ZERO, 0_u64);
    for (y, x) in (0..size.y)
        .step_by(STRIDE)
        .flat_map(|y| (0..size.x).step_by(STRIDE).map(move |x| (y, x)))
    {
        let place = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let direction = ((place - whole.center) / whole.focal).extend(1.0);
        if candidate.pixel(direction, reach).is_some() {
            low = low.min(glam::UVec2::new(x, y));
            high = high.max(glam::UVec2::new(x, y));
            seen += (STRIDE * STRIDE) as u64;
        }
    }
    let photo = u64::from(optics.size[0]) * u64::from(optics.size[1]);
    if (seen as f64) < SHARE_MIN * photo as f64 {
        return None;
    }
    let low = low.saturating_sub(glam::UVec2::splat(STRIDE as u32));
    let high = (high + 2 * STRIDE as u32).min(size);
    let cropped = Camera {
        width: high.x - low.x,
        height: high.y - low.y,
        center: whole.center - low.as_dvec2(),
        ..whole
    };
    Some(Optics {
        pinhole: cropped,
        ..candidate
    })
}
