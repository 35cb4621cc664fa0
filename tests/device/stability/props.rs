//! Hand-made scenes: an upright camera at the origin and splats placed by pixel and depth.

use crate::common::scenes::Scene;
use ashfall::reference::Options;
use ashfall::scene::{Camera, SH_C0, ScreenFilter, Splats};
use glam::{DMat3, DVec2, DVec3};

/// Opacity logit of an opaque splat: opacity 1 − 4e-18.
pub(crate) const OPAQUE: f32 = 40.0;

/// An empty scene over black with an upright camera at the origin; its focal length is the image's width.
pub(crate) fn stage(width: u32, height: u32) -> Scene {
    Scene {
        splats: Splats {
            filter: ScreenFilter::Classic,
            ..Splats::default()
        },
        camera: Camera {
            width,
            height,
            focal: DVec2::splat(f64::from(width)),
            center: DVec2::new(f64::from(width), f64::from(height)) * 0.5,
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        },
        options: Options {
            background: [0.0; 3],
            near: f64::from(0.01f32),
            sh_degree: 0,
            ..Options::default()
        },
    }
}

/// A splat to be placed on a stage.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prop {
    /// Position of the centre on the screen, pixels.
    pub(crate) pixel: [f64; 2],
    /// World units along z.
    pub(crate) depth: f64,
    /// Standard deviations seen face-on, pixels.
    pub(crate) sigma: [f64; 3],
    /// w, x, y, z.
    pub(crate) quaternion: [f64; 4],
    pub(crate) logit: f32,
    pub(crate) color: [f64; 3],
}

impl Prop {
    /// A ball at depth 4.
    pub(crate) fn ball(pixel: [f64; 2], sigma: f64, logit: f32) -> Prop {
        Prop {
            pixel,
            depth: 4.0,
            sigma: [sigma; 3],
            quaternion: [1.0, 0.0, 0.0, 0.0],
            logit,
            color: [1.0; 3],
        }
    }
}

/// The logit of an opacity below 1.
pub(crate) fn logit(opacity: f64) -> f32 {
    (opacity / (1.0 - opacity)).ln() as f32
}

/// Appends a splat to the scene; SH coefficients beyond the constant are 0.
pub(crate) fn place(scene: &mut Scene, prop: &Prop) {
    let camera = &scene.camera;
    let ray = ((DVec2::from(prop.pixel) - camera.center) / camera.focal).extend(1.0);
    let mean = camera.position + camera.rotation.transpose() * (ray * prop.depth);
    let unit = prop.depth.abs() / camera.focal.x;
    let splats = &mut scene.splats;
    splats.mean.push(mean.to_array().map(|x| x as f32));
    splats.quaternion.push(prop.quaternion.map(|x| x as f32));
    splats.log_scale.push(prop.sigma.map(|s| (s * unit).ln() as f32));
    splats.opacity_logit.push(prop.logit);
    let stride = splats.sh_stride();
    let mut sh = vec![0.0; stride];
    for (to, color) in sh.iter_mut().zip(prop.color) {
        *to = (color as f32 - 0.5) / SH_C0;
    }
    splats.sh.extend(sh);
}

/// The splats of the given indices, in their order; repetitions allowed.
pub(crate) fn picked(splats: &Splats, order: &[usize]) -> Splats {
    let stride = splats.sh_stride();
    let row = |&i: &usize| splats.sh[i * stride..][..stride].to_vec();
    Splats {
        mean: order.iter().map(|&i| splats.mean[i]).collect(),
        quaternion: order.iter().map(|&i| splats.quaternion[i]).collect(),
        log_scale: order.iter().map(|&i| splats.log_scale[i]).collect(),
        opacity_logit: order.iter().map(|&i| splats.opacity_logit[i]).collect(),
        sh: order.iter().flat_map(row).collect(),
        ..splats.clone()
    }
}

/// The scene with a changed copy of splat 0 appended.
pub(crate) fn with_copy(scene: &Scene, change: impl FnOnce(&mut Splats, usize)) -> Scene {
    let count = scene.splats.len();
    let order: Vec<usize> = (0..count).chain([0]).collect();
    let mut more = Scene {
        splats: picked(&scene.splats, &order),
        ..scene.clone()
    };
    change(&mut more.splats, count);
    more
}

/// Sets one of a splat's parameters, numbered as mean, quaternion, log-scale, opacity, SH coefficients.
pub(crate) fn set(splats: &mut Splats, splat: usize, parameter: usize, value: f32) {
    let stride = splats.sh_stride();
    match parameter {
        0..3 => splats.mean[splat][parameter] = value,
        3..7 => splats.quaternion[splat][parameter - 3] = value,
        7..10 => splats.log_scale[splat][parameter - 7] = value,
        10 => splats.opacity_logit[splat] = value,
        _ => splats.sh[splat * stride + parameter - 11] = value,
    }
}
