//! Sweeps of one parameter over its range: needles, zoom, approach, near plane, distance from the origin.

use super::outcome::{CheckGroup, Sweep, SweepPoint, Thumbnail};
use super::{OF_RANGE, ScenePair, StressRun, subject, thumbnail};
use crate::Result;
use crate::lab::bench::input::random::single;
use crate::lab::page::short_number;
use crate::scene::{Camera, Splats};
use glam::DVec3;

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    needles(lab)?;
    zoom(lab)?;
    approach(lab)?;
    near_plane(lab)?;
    far_origin(lab)
}

/// Scene and camera at one value of a parameter.
struct Setting {
    x: f64,
    label: String,
    pair: ScenePair,
    camera: Camera,
    near: f64,
}

/// Compares every picture of a sweep with the reference.
fn take(
    lab: &mut StressRun<'_>,
    settings: impl IntoIterator<Item = Setting>,
) -> Result<(Vec<SweepPoint>, Vec<Thumbnail>)> {
    let (mut points, mut thumbnails) = (Vec::new(), Vec::new());
    for setting in settings {
        let (image, compared) = lab.look(&setting.pair, &setting.camera, setting.near)?;
        points.push(SweepPoint {
            x: setting.x,
            measured: compared.measured,
            bound: compared.bound,
        });
        thumbnails.push(thumbnail(setting.label, &image));
    }
    Ok((points, thumbnails))
}

/// `count` powers of a base from exponent `from`, fewer in a quick run.
fn powers(lab: &StressRun<'_>, base: f64, from: i32, count: i32) -> Vec<f64> {
    let step = if lab.plan.is_quick { 3 } else { 1 };
    let exponents = (from..from + count).step_by(step);
    exponents.map(|exponent| base.powi(exponent)).collect()
}

/// Splats stretched along their longest axis and thinned by the same factor.
pub(super) fn stretched(splats: &Splats, aspect: f64) -> Splats {
    let by = (0.5 * aspect.ln()) as f32;
    let mut needles = splats.clone();
    for scale in &mut needles.log_scale {
        let longest = (0..3).max_by(|&a, &b| scale[a].total_cmp(&scale[b]));
        for (axis, value) in scale.iter_mut().enumerate() {
            *value += if Some(axis) == longest { by } else { -by };
        }
    }
    needles
}

fn needles(lab: &mut StressRun<'_>) -> Result<()> {
    let few = ScenePair::of(lab.subject).thinned(120);
    let (camera, near) = (*lab.subject.camera(), lab.subject.near);
    let setting = |aspect: f64| Setting {
        x: aspect,
        label: format!("× {}", short_number(aspect)),
        pair: few.map(|splats| stretched(splats, aspect)),
        camera,
        near,
    };
    let aspects = powers(lab, 10.0, 0, 7);
    let (points, thumbnails) = take(lab, aspects.into_iter().map(setting))?;
    let sweep = Sweep {
        group: CheckGroup::Sweeps,
        title: "Needles".into(),
        parameter: "axes stretched apart by a factor of",
        is_log: true,
        quantity: "error, of 1",
        caption: "Up to 120 splats of the scene, one axis longer and two thinner. Determinants of such covariances \
                  cancel."
            .into(),
        points,
        thumbnails,
    };
    lab.sweep(sweep, OF_RANGE);
    Ok(())
}

fn zoom(lab: &mut StressRun<'_>) -> Result<()> {
    let pair = ScenePair::of(lab.subject);
    let (camera, near) = (*lab.subject.camera(), lab.subject.near);
    let setting = |factor: f64| Setting {
        x: factor,
        label: format!("× {}", short_number(factor)),
        pair: pair.clone(),
        camera: subject::exact(&Camera {
            focal: camera.focal * factor,
            ..camera
        }),
        near,
    };
    let factors = powers(lab, 2.0, -5, 13);
    let (points, thumbnails) = take(lab, factors.into_iter().map(setting))?;
    let sweep = Sweep {
        group: CheckGroup::Sweeps,
        title: "Zoom".into(),
        parameter: "focal length, of the first view's",
        is_log: true,
        quantity: "error, of 1",
        caption: "From splats much smaller than a pixel to splats wider than the picture.".into(),
        points,
        thumbnails,
    };
    lab.sweep(sweep, OF_RANGE);
    Ok(())
}

fn approach(lab: &mut StressRun<'_>) -> Result<()> {
    let pair = ScenePair::of(lab.subject);
    let (camera, target) = (*lab.subject.camera(), lab.subject.target);
    let near = single(1e-3 * lab.subject.distance());
    let setting = |share: f64| Setting {
        x: share,
        label: short_number(share),
        pair: pair.clone(),
        camera: subject::exact(&Camera {
            position: target + (camera.position - target) * share,
            ..camera
        }),
        near,
    };
    let shares = (0..13).step_by(if lab.plan.is_quick { 3 } else { 1 });
    let shares = shares.map(|i| 0.6f64.powi(12 - i)).collect::<Vec<f64>>();
    let (points, thumbnails) = take(lab, shares.into_iter().map(setting))?;
    let sweep = Sweep {
        group: CheckGroup::Sweeps,
        title: "Into the scene".into(),
        parameter: "distance from what is looked at, of the first view's",
        is_log: true,
        quantity: "error, of 1",
        caption: "Splats pass by the camera at any distance; the near plane is a thousandth of the way.".into(),
        points,
        thumbnails,
    };
    lab.sweep(sweep, OF_RANGE);
    Ok(())
}

fn near_plane(lab: &mut StressRun<'_>) -> Result<()> {
    let pair = ScenePair::of(lab.subject);
    let (camera, distance) = (*lab.subject.camera(), lab.subject.distance());
    let shares = [1e-6, 1e-3, 0.03, 0.1, 0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 2.0];
    let setting = |&share: &f64| Setting {
        x: share,
        label: short_number(share),
        pair: pair.clone(),
        camera,
        near: single(share * distance),
    };
    let step = if lab.plan.is_quick { 3 } else { 1 };
    let (points, thumbnails) = take(lab, shares.iter().step_by(step).map(setting))?;
    let sweep = Sweep {
        group: CheckGroup::Sweeps,
        title: "Near plane".into(),
        parameter: "near plane, of the distance to what is looked at",
        is_log: true,
        quantity: "error, of 1",
        caption: "Splats whose centre is nearer are not drawn.".into(),
        points,
        thumbnails,
    };
    lab.sweep(sweep, OF_RANGE);
    Ok(())
}

fn far_origin(lab: &mut StressRun<'_>) -> Result<()> {
    let pair = ScenePair::of(lab.subject);
    let (camera, near) = (*lab.subject.camera(), lab.subject.near);
    let distance = lab.subject.distance();
    let setting = |factor: f64| {
        let by = DVec3::new(0.8, -0.5, 0.33) * (factor * distance);
        let place = |mean: &[f32; 3]| (DVec3::from(mean.map(f64::from)) + by).as_vec3().to_array();
        Setting {
            x: factor,
            label: format!("× {}", short_number(factor)),
            pair: pair.with(|splats| splats.mean = splats.mean.iter().map(place).collect()),
            camera: subject::exact(&Camera {
                position: camera.position + by,
                ..camera
            }),
            near,
        }
    };
    let factors = powers(lab, 10.0, 0, 8);
    let (points, thumbnails) = take(lab, factors.into_iter().map(setting))?;
    let sweep = Sweep {
        group: CheckGroup::Sweeps,
        title: "Far from the origin".into(),
        parameter: "distance of scene and camera from the origin, of that between them",
        is_log: true,
        quantity: "error, of 1",
        caption: "Positions are stored in single precision and snap to ever coarser steps, as the pictures show. What \
                  is stored is drawn as exactly as ever: differences are taken first."
            .into(),
        points,
        thumbnails,
    };
    lab.sweep(sweep, OF_RANGE);
    Ok(())
}
