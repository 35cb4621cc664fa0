//! NaN, infinities and extreme values in every parameter of a splat.

use super::gradients::KINDS;
use super::step::{StepResult, steps};
use super::{StressRun, differing, subject, thumbnail};
use crate::Result;
use crate::render::RenderedImage;
use crate::scene::{Camera, Splats};
use std::ops::Range;

/// NaN and infinities.
const NONE: [f32; 4] = [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY];

/// Extreme finite values: the ends of the range, subnormals, and limits of exponentials and casts.
const EXTREME: [f32; 14] = [
    0.0,
    -0.0,
    f32::MIN_POSITIVE,
    1e-40,
    -1e-40,
    1e20,
    -1e20,
    1e38,
    f32::MAX,
    f32::MIN,
    88.73,
    -104.0,
    3e9,
    16_777_217.0,
];

/// Sets one of a splat's parameters.
fn set(splats: &mut Splats, splat: usize, slot: usize, value: f32) {
    let stride = splats.sh_stride();
    match slot {
        0..3 => splats.mean[splat][slot] = value,
        3..7 => splats.quaternion[splat][slot - 3] = value,
        7..10 => splats.log_scale[splat][slot - 7] = value,
        10 => splats.opacity_logit[splat] = value,
        _ => splats.sh[splat * stride + slot - 11] = value,
    }
}

/// The scene, followed by a copy of one of its splats for each value, with the value in the slot.
fn poisoned(splats: &Splats, slots: Range<usize>, values: &[f32]) -> Splats {
    let count = splats.len();
    let copies = slots.len() * values.len();
    let order: Vec<usize> = (0..count).chain((0..copies).map(|i| i * 7919 % count)).collect();
    let mut more = splats.picked(&order);
    let all = slots.flat_map(|slot| values.iter().map(move |&value| (slot, value)));
    for (i, (slot, value)) in all.enumerate() {
        set(&mut more, count + i, slot, value);
    }
    more
}

fn not_finite(image: &RenderedImage) -> usize {
    let pixels = image.rgb.iter().zip(&image.transmittance);
    pixels
        .filter(|(rgb, passes)| !rgb.iter().chain([*passes]).all(|value| value.is_finite()))
        .count()
}

pub(super) fn run(lab: &mut StressRun<'_>) -> Result<()> {
    let splats = lab.subject.splats.clone();
    if splats.is_empty() {
        return Ok(());
    }
    let (camera, near) = (*lab.subject.camera(), lab.subject.near);
    let clean = lab.draw(&splats, &camera, near)?;
    let mut thumbnails = vec![thumbnail("clean", &clean)];
    for (kind, slots) in KINDS {
        let slots = slots.start..slots.end.min(11 + splats.sh_stride());
        let mut worst = [0, 0];
        let mut last = None;
        for slot in slots.clone() {
            let none = lab.draw(&poisoned(&splats, slot..slot + 1, &NONE), &camera, near)?;
            worst[0] = worst[0].max(differing(&none, &clean));
            let extreme = lab.draw(&poisoned(&splats, slot..slot + 1, &EXTREME), &camera, near)?;
            worst[1] = worst[1].max(not_finite(&extreme));
            last = Some((none, extreme));
        }
        let place = match slots.len() {
            1 => "its slot".into(),
            count => format!("each of {count} slots"),
        };
        let what = format!("NaN and ±∞ in {place}, one splat each");
        lab.none(format!("{kind}: no number"), what, worst[0], "pixels that changed");
        let what = format!("{} finite numbers in {place}, one splat each", EXTREME.len());
        lab.none(format!("{kind}: extreme numbers"), what, worst[1], "pixels not finite");
        if let Some((none, extreme)) = last {
            thumbnails.push(thumbnail(format!("{kind}: NaN, ±∞"), &none));
            thumbnails.push(thumbnail(format!("{kind}: extremes"), &extreme));
        }
    }
    let caption = "Pictures with numbers that are none must be the clean one. Extreme numbers may show: they are \
                   drawn as what they say, in the last slot of each kind.";
    lab.pictures(caption, thumbnails);
    learning(lab, &camera)
}

/// A training step from a scene with all poisoned values.
fn learning(lab: &mut StressRun<'_>, camera: &Camera) -> Result<()> {
    let splats = &subject::thinned(&lab.subject.splats, 200);
    let all = 0..11 + splats.sh_stride();
    let step = |splats: &Splats| steps(lab.gpu, splats, camera, lab.subject.near, 1);
    let (clean, none) = (step(splats)?, step(&poisoned(splats, all.clone(), &NONE))?);
    let extreme = step(&poisoned(splats, all, &EXTREME))?;
    let changed = (0..splats.len()).filter(|&i| bits(&clean, i) != bits(&none, i)).count();
    let moved = (splats.len()..none.after.len())
        .filter(|&i| none.row(i).iter().any(|d| *d != 0.0))
        .count();
    let what = "NaN and ±∞ in every slot, one splat each: the gradients of all others";
    lab.none("a training step: others", what, changed, "splats that changed");
    let what = "the gradients of the poisoned splats themselves are 0";
    lab.none("a training step: poisoned", what, moved, "splats with a gradient");
    let what = "finite numbers at the ends of the range in every slot: the optimiser's moments stay finite";
    let moments = extreme.after.m.iter().chain(&extreme.after.v).flatten().flatten();
    let broken = moments.filter(|value| !value.is_finite()).count();
    lab.none("a training step: extremes", what, broken, "moments not finite");
    Ok(())
}

fn bits(stepped: &StepResult, splat: usize) -> Vec<u32> {
    stepped.row(splat).iter().map(|d| d.to_bits()).collect()
}
