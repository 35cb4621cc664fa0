//! Degenerate scenes and cameras: zero divisors, equal depths, empty images.

use super::outcome::Thumbnail;
use super::{OF_RANGE, StressRun, StressScene, subject, thumbnail};
use crate::Result;
use crate::scene::{Camera, Splats};
use glam::{DMat3, DVec2, DVec3};

/// A change of the scene.
type SceneEdit = fn(&mut Splats, &Camera);

/// Name, expectation and edit of each degenerate scene.
const SCENES: [(&str, &str, SceneEdit); 13] = [
    ("no splats", "nothing but background", |s, _| *s = s.picked(&[])),
    ("one splat", "one alone", |s, _| *s = s.picked(&[0])),
    (
        "one place",
        "all splats have one centre, so that only their index orders them",
        |s, _| {
            let middle = s.mean[0];
            s.mean.fill(middle);
        },
    ),
    ("one splat, many times", "300 copies of one splat", |s, _| {
        *s = s.picked(&[0; 300]);
    }),
    (
        "one plane",
        "all splats at one depth, where rounding decides which come first",
        |s, camera| {
            let forward = camera.rotation.row(2);
            let middle = camera.position + 3.0 * forward;
            for mean in &mut s.mean {
                let place = DVec3::from(mean.map(f64::from));
                let off = forward * (place - middle).dot(forward);
                *mean = (place - off).as_vec3().to_array();
            }
        },
    ),
    ("at the camera", "a splat at the camera's very centre", |s, camera| {
        s.mean[0] = camera.position.as_vec3().to_array();
    }),
    ("transparent", "opacities of 4e-18", |s, _| s.opacity_logit.fill(-40.0)),
    ("opaque", "opacities of 1 − 4e-18", |s, _| s.opacity_logit.fill(40.0)),
    ("points", "standard deviations of 1e-26", |s, _| {
        s.log_scale.fill([-60.0; 3])
    }),
    ("discs without thickness", "one axis of 1e-39", |s, _| {
        s.log_scale.iter_mut().for_each(|scale| scale[2] = -90.0);
    }),
    (
        "without orientation",
        "quaternions of length 0: no splat is drawn",
        |s, _| {
            s.quaternion.fill([0.0; 4]);
        },
    ),
    ("odd quaternions", "lengths of 1e12 and 1e-12", |s, _| {
        for (i, quaternion) in s.quaternion.iter_mut().enumerate() {
            let factor = if i % 2 == 0 { 1e12 } else { 1e-12 };
            *quaternion = quaternion.map(|q| q * factor);
        }
    }),
    ("glaring", "colours of 100 and below 0", |s, _| {
        s.sh.iter_mut().for_each(|value| *value *= 200.0);
    }),
];

/// A change of the camera, given its target.
type CameraEdit = fn(&Camera, DVec3) -> Camera;

const CAMERAS: [(&str, &str, CameraEdit); 9] = [
    ("looking away", "everything lies behind the camera", |c, target| {
        c.look_at(c.position, 2.0 * c.position - target, DVec3::NEG_Y)
    }),
    ("in the midst", "the camera stands where it looked at", |c, target| {
        Camera { position: target, ..*c }
    }),
    ("from very far", "a thousand times the distance", |c, target| Camera {
        position: target + (c.position - target) * 1e3,
        ..*c
    }),
    ("very wide", "a field of view of 179°", |c, _| Camera {
        focal: c.focal * (0.0087 * 0.5 * f64::from(c.width) / c.focal.x),
        ..*c
    }),
    ("very narrow", "a field of view of a hundredth of a degree", |c, _| {
        Camera {
            focal: c.focal * (f64::from(c.width) / (1.745e-4 * c.focal.x)),
            ..*c
        }
    }),
    (
        "unequal focal lengths",
        "pixels a hundred times as high as wide",
        |c, _| Camera {
            focal: DVec2::new(c.focal.x, 0.01 * c.focal.y),
            ..*c
        },
    ),
    (
        "principal point",
        "five widths beside the picture, and the camera turned as far",
        |c, _| {
            let beside = 5.0 * f64::from(c.width);
            let turn = DMat3::from_rotation_y(-(beside / c.focal.x).atan());
            Camera {
                center: c.center + DVec2::new(beside, 0.0),
                rotation: turn * c.rotation,
                ..*c
            }
        },
    ),
    ("mirrored", "left is right", |c, _| Camera {
        rotation: DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)) * c.rotation,
        ..*c
    }),
    ("upside down", "turned by half a circle", |c, _| Camera {
        rotation: DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)) * c.rotation,
        ..*c
    }),
];

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    let (scene, camera) = (lab.subject, lab.subject.camera());
    let mut thumbnails = Vec::new();
    for (index, camera) in scene.cameras.iter().enumerate() {
        let name = format!("view {}", index + 1);
        thumbnails.push(check(lab, &name, "the scene as it is", scene, camera)?);
    }
    if scene.is_made {
        for (name, what, change) in SCENES {
            let changed = scene.changed(|splats| change(splats, camera));
            thumbnails.push(check(lab, name, what, &changed, camera)?);
        }
    }
    for (name, what, turn) in CAMERAS {
        let turned = subject::exact(&turn(camera, scene.target));
        thumbnails.push(check(lab, name, what, scene, &turned)?);
    }
    lab.pictures("", thumbnails);
    Ok(())
}

fn check(lab: &mut StressRun<'_>, name: &str, what: &str, scene: &StressScene, camera: &Camera) -> Result<Thumbnail> {
    let (image, errors) = lab.look(scene, camera)?;
    lab.at_most(name, what, errors, OF_RANGE);
    Ok(thumbnail(name, &image))
}
