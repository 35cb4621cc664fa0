//! Sweeps of one parameter over its range: needles, zoom, approach, near plane, distance from the origin.

use super::outcome::{CheckGroup, Sweep, SweepPoint};
use super::{OF_RANGE, StressRun, StressScene, subject, thumbnail};
use crate::Result;
use crate::lab::bench::input::random::single;
use crate::lab::page::short_number;
use crate::render::RenderedImage;
use crate::scene::Splats;
use glam::DVec3;

/// Compares the subject's picture at every value of a parameter with the reference. The texts are those of
/// [`sweep_pictures`].
fn sweep(
    lab: &mut StressRun<'_>,
    texts: [&'static str; 4],
    values: impl IntoIterator<Item = f64>,
    change: impl Fn(&mut StressScene, f64),
) -> Result<()> {
    sweep_pictures(lab, texts, values, |lab, x| {
        let mut scene = lab.subject.clone();
        change(&mut scene, x);
        let camera = subject::exact(scene.camera());
        lab.look(&scene, &camera)
    })
}

/// Takes a picture, its error and the error's bound at every value of a parameter, in a quick run at every third. The
/// texts are title, parameter, sign before its values, and caption.
pub(super) fn sweep_pictures(
    lab: &mut StressRun<'_>,
    [title, parameter, sign, caption]: [&'static str; 4],
    values: impl IntoIterator<Item = f64>,
    mut look: impl FnMut(&mut StressRun<'_>, f64) -> Result<(RenderedImage, [f64; 2])>,
) -> Result<()> {
    let (mut points, mut thumbnails) = (Vec::new(), Vec::new());
    for x in values.into_iter().step_by(if lab.plan.is_quick { 3 } else { 1 }) {
        let (image, [measured, bound]) = look(lab, x)?;
        points.push(SweepPoint { x, measured, bound });
        thumbnails.push(thumbnail(format!("{sign}{}", short_number(x)), &image));
    }
    let sweep = Sweep {
        group: CheckGroup::Sweeps,
        title,
        parameter,
        is_log: true,
        quantity: "error, of 1",
        caption,
        points,
        thumbnails,
    };
    lab.sweep(sweep, OF_RANGE);
    Ok(())
}

/// Stretches splats along their longest axis and thins them by the same factor.
pub(super) fn stretch(splats: &mut Splats, aspect: f64) {
    let by = (0.5 * aspect.ln()) as f32;
    for scale in &mut splats.log_scale {
        let longest = (0..3).max_by(|&a, &b| scale[a].total_cmp(&scale[b]));
        for (axis, value) in scale.iter_mut().enumerate() {
            *value += if Some(axis) == longest { by } else { -by };
        }
    }
}

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    let (target, distance) = (lab.subject.target, lab.subject.distance());
    let powers = |base: f64, exponents: std::ops::Range<i32>| exponents.map(move |exponent| base.powi(exponent));
    let texts = [
        "Needles",
        "axes stretched apart by a factor of",
        "× ",
        "Up to 120 splats of the scene, one axis longer and two thinner. Determinants of such covariances cancel.",
    ];
    sweep(lab, texts, powers(10.0, 0..7), |scene, aspect| {
        *scene = scene.changed(|splats| {
            *splats = subject::thinned(splats, 120);
            stretch(splats, aspect);
        });
    })?;
    let texts = [
        "Zoom",
        "focal length, of the first view's",
        "× ",
        "From splats much smaller than a pixel to splats wider than the picture.",
    ];
    sweep(lab, texts, powers(2.0, -5..8), |scene, factor| {
        scene.cameras[0].focal *= factor
    })?;
    let texts = [
        "Into the scene",
        "distance from what is looked at, of the first view's",
        "",
        "Splats pass by the camera at any distance; the near plane is a thousandth of the way.",
    ];
    let shares = (0..13).map(|i| 0.6f64.powi(12 - i));
    sweep(lab, texts, shares, |scene, share| {
        scene.cameras[0].position = target + (scene.cameras[0].position - target) * share;
        scene.near = single(1e-3 * distance);
    })?;
    let texts = [
        "Near plane",
        "near plane, of the distance to what is looked at",
        "",
        "Splats whose centre is nearer are not drawn.",
    ];
    let shares = [1e-6, 1e-3, 0.03, 0.1, 0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 2.0];
    sweep(lab, texts, shares, |scene, share| scene.near = single(share * distance))?;
    let texts = [
        "Far from the origin",
        "distance of scene and camera from the origin, of that between them",
        "× ",
        "Positions are stored in single precision and snap to ever coarser steps, as the pictures show. What is stored \
         is drawn as exactly as ever: differences are taken first.",
    ];
    sweep(lab, texts, powers(10.0, 0..8), |scene, factor| {
        let by = DVec3::new(0.8, -0.5, 0.33) * (factor * distance);
        let place = |mean: &[f32; 3]| (DVec3::from(mean.map(f64::from)) + by).as_vec3().to_array();
        *scene = scene.changed(|splats| splats.mean = splats.mean.iter().map(place).collect());
        scene.cameras[0].position += by;
    })
}
