//! Gradients of a training step against the exact ones.

use super::outcome::{CheckGroup, Sweep, SweepPoint};
use super::step::steps;
use super::subject::{reduced, reference_options, thinned};
use super::sweeps::stretch;
use super::{StressRun, StressScene};
use crate::Result;
use crate::reference::loss::Target;
use crate::reference::loss_gradient;
use crate::scene::Camera;

/// Kinds of parameters, in the order of `reference::Splat::parameters`.
pub(super) const KINDS: [(&str, std::ops::Range<usize>); 5] = [
    ("mean", 0..3),
    ("quaternion", 3..7),
    ("log-scale", 7..10),
    ("opacity", 10..11),
    ("harmonics", 11..usize::MAX),
];

/// Least denominator of relative errors, as a share of the kind's root mean square: values that are small in their kind
/// are remainders of terms that cancel.
const SHARE: f64 = 0.01;

/// Bounds of the median and of the 99th percentile. Cancellation within a gradient amplifies the rounding of single
/// precision, depending on the scene; these are the developers' bounds for gentle and difficult scenes.
const BOUNDS: [f64; 2] = [1e-5, 1e-3];

/// Increase of the bound per unit of a needle's aspect: sixteen roundings of numbers of a needle's length, in units of
/// its width.
const NEEDLE: f64 = 16.0 / 16_777_216.0;

/// Most splats of a compared step.
const SPLATS: usize = 150;

/// The error at a share of ascending ones.
fn percentile(errors: &[f64], share: f64) -> f64 {
    let last = errors.len().saturating_sub(1);
    errors.get((last as f64 * share) as usize).copied().unwrap_or(f64::NAN)
}

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    // A small view, because the reference takes every pixel through every splat, forward and backward.
    let camera = reduced(lab.subject.camera(), 48);
    let scene = seen(lab.subject, &camera);
    let (loss, kinds) = judge(lab, &scene, &camera)?;
    let unit = "relative";
    let what = "(1 − λ) L1 + λ (1 − SSIM) against the exact one";
    lab.at_most("loss", what, [loss, 1e-5], unit);
    for ((name, _), errors) in KINDS.iter().zip(&kinds) {
        for (share, bound, word) in [(0.5, BOUNDS[0], "median"), (0.99, BOUNDS[1], "99 %")] {
            let [derivatives, splats] = [errors.len(), scene.splats.len()];
            let what = format!("{derivatives} derivatives of {splats} splats");
            lab.at_most(
                format!("{name}, {word}"),
                what,
                [percentile(errors, share), bound],
                unit,
            );
        }
    }
    let step = if lab.plan.is_quick { 2 } else { 1 };
    let mut points = Vec::new();
    for exponent in (0..=8).step_by(step) {
        let aspect = 10f64.powf(0.5 * f64::from(exponent));
        let needles = scene.changed(|splats| stretch(splats, aspect));
        let (_, kinds) = judge(lab, &needles, &camera)?;
        let worst = kinds.iter().map(|errors| percentile(errors, 0.99));
        points.push(SweepPoint {
            x: aspect,
            // NaN must propagate.
            measured: worst.fold(0.0, |most: f64, e| if e > most || e.is_nan() { e } else { most }),
            bound: BOUNDS[1] + NEEDLE * aspect,
        });
    }
    let sweep = Sweep {
        group: CheckGroup::Gradients,
        title: "Gradients of needles",
        parameter: "axes stretched apart by a factor of",
        is_log: true,
        quantity: "relative error, 99 %",
        caption: "The 99th percentile of the kind of parameters that is worst. The bound grows by sixteen roundings of \
                  a needle's length, in units of its width.",
        points,
        ..Sweep::default()
    };
    lab.sweep(sweep, unit);
    Ok(())
}

/// The scene with some of the splats in the image.
fn seen(scene: &StressScene, camera: &Camera) -> StressScene {
    let inside = |mean: &[f32; 3]| {
        let place = glam::DVec3::from(mean.map(f64::from));
        let depth = camera.view_from_world(place).z;
        let pixel = camera.pixel_from_world(place);
        let size = glam::DVec2::new(f64::from(camera.width), f64::from(camera.height));
        depth > 2.0 * scene.near && pixel.is_some_and(|p| p.cmpge(glam::DVec2::ZERO).all() && p.cmplt(size).all())
    };
    let splats = &scene.splats;
    let kept: Vec<usize> = (0..splats.len()).filter(|&i| inside(&splats.mean[i])).collect();
    scene.changed(|splats| *splats = thinned(&splats.picked(&kept), SPLATS))
}

/// Errors of a step on the device against the reference: of the loss, and of the gradient by kind of parameter,
/// ascending.
fn judge(lab: &StressRun<'_>, scene: &StressScene, camera: &Camera) -> Result<(f64, Vec<Vec<f64>>)> {
    let found = steps(lab.gpu, &scene.splats, camera, scene.near, 1)?;
    let options = reference_options(&scene.exact, found.near);
    let photo = vec![[0.0; 3]; camera.width as usize * camera.height as usize];
    let target = Target {
        lambda: found.lambda,
        ..Target::new(camera.width as usize, &photo)
    };
    let exact = loss_gradient(&scene.exact, camera, &options, &target);
    let rows = crate::lab::bench::input::pack::gradient_rows(&exact.d_splats);
    let of_kind = |range: &std::ops::Range<usize>| -> Vec<f64> {
        let mut pairs = Vec::new();
        for (splat, row) in rows.iter().enumerate() {
            let range = range.start..range.end.min(row.len());
            let found = found.row(splat);
            let both = found[range.clone()].iter().zip(&row[range]);
            pairs.extend(both.map(|(&found, &exact)| (f64::from(found), exact)));
        }
        relative(&pairs)
    };
    let kinds = KINDS.iter().map(|(_, range)| of_kind(range)).collect();
    Ok(((found.loss / exact.loss - 1.0).abs(), kinds))
}

/// Relative errors of (found, exact) pairs, ascending, without pairs of two zeros.
fn relative(pairs: &[(f64, f64)]) -> Vec<f64> {
    let square: f64 = pairs.iter().map(|(_, exact)| exact * exact).sum();
    let floor = SHARE * (square / pairs.len().max(1) as f64).sqrt();
    let judged = pairs.iter().filter(|(found, exact)| *exact != 0.0 || *found != 0.0);
    let mut errors: Vec<f64> = judged
        .map(|(found, exact)| (found - exact).abs() / exact.abs().max(floor))
        .collect();
    errors.sort_by(f64::total_cmp);
    errors
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_to_what_is_usual() {
        let errors = relative(&[(1.01, 1.0), (0.0, 0.0), (1e-9, 0.0), (-1.0, -1.0)]);
        assert_eq!(errors.len(), 3);
        assert_eq!(errors[0], 0.0);
        assert!((errors[2] - 0.01).abs() < 1e-12 && errors[1] < 1e-6);
    }
}
