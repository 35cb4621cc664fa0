//! Properties of a step that need no oracle: invisible splats change nothing, order does not matter, NaNs affect no
//! other splat.

use crate::common::device;
use crate::common::scenes;
use crate::gradients::{BEGUN, Stepped, config, step, step_by};
use ashfall::reference::dropout::Dropout;
use ashfall::scene::Splats;
use ashfall::train::state::Planes;
use ashfall::train::{HostState, TrainConfig, schedule};

/// Appends a copy of splat `index` with its parameters changed.
pub(crate) fn append(splats: &mut Splats, index: usize, change: impl FnOnce(&mut [Option<&mut f32>])) {
    let stride = splats.sh_stride();
    splats.mean.push(splats.mean[index]);
    splats.quaternion.push(splats.quaternion[index]);
    splats.log_scale.push(splats.log_scale[index]);
    splats.opacity_logit.push(splats.opacity_logit[index]);
    let sh = splats.sh[index * stride..][..stride].to_vec();
    splats.sh.extend(sh);
    let last = splats.mean.len() - 1;
    let mut slots: Vec<Option<&mut f32>> = splats.mean[last].iter_mut().map(Some).collect();
    slots.extend(splats.quaternion[last].iter_mut().map(Some));
    slots.extend(splats.log_scale[last].iter_mut().map(Some));
    slots.push(Some(&mut splats.opacity_logit[last]));
    slots.extend(splats.sh[last * stride..].iter_mut().map(Some));
    change(&mut slots);
}

/// Bits of the first `count` splats' gradients.
fn bits(gradients: &Planes, count: usize) -> Vec<[u32; 4]> {
    let four = |four: &[f32; 4]| four.map(f32::to_bits);
    gradients
        .iter()
        .flat_map(|plane| plane[..count].iter().map(four))
        .collect()
}

/// Asserts that the splats from `count` on are invisible and change nothing.
#[track_caller]
fn assert_unseen(name: &str, found: &Stepped, clean: &Stepped, count: usize) {
    assert!(found.image == clean.image, "{name}: the image changed");
    assert!(
        bits(&found.gradients, count) == bits(&clean.gradients, count),
        "{name}: a neighbour's gradient changed"
    );
    for four in found.gradients.iter().flat_map(|plane| &plane[count..]) {
        assert_eq!(*four, [0.0; 4], "{name}: a gradient of what is not seen");
    }
}

#[test]
fn what_is_not_seen_changes_nothing() {
    let gpu = device::gpu();
    let scene = scenes::gentle(56, 30, 40, 33, 1);
    let count = scene.splats.len();
    let clean = step(&gpu, &scene);
    let backward = scene.camera.rotation.row(2);
    let behind = (scene.camera.position - backward * 2.0).as_vec3();
    let sideways = scene.camera.rotation.row(0);
    let beside = (scene.camera.position + backward * 3.0 + sideways * 300.0).as_vec3();
    for (name, place, logit) in [
        ("faint", None, Some(-5.6)),
        ("behind the camera", Some(behind), None),
        ("off the screen", Some(beside), None),
    ] {
        let mut more = scene.clone();
        for index in 0..5 {
            append(&mut more.splats, index, |slots| {
                for (slot, x) in slots.iter_mut().zip(place.unwrap_or_default().to_array()) {
                    if let (Some(slot), true) = (slot, place.is_some()) {
                        **slot = x;
                    }
                }
                if let (Some(Some(slot)), Some(logit)) = (slots.get_mut(10), logit) {
                    **slot = logit;
                }
            });
        }
        assert_unseen(name, &step(&gpu, &more), &clean, count);
    }
}

#[test]
fn what_lies_behind_an_opaque_stack_changes_nothing() {
    let gpu = device::gpu();
    let mut scene = scenes::gentle(57, 30, 40, 33, 0);
    // A wall near the camera: wide, opaque, two deep, so that the transmittance behind it is 0.
    let axis = scene.camera.rotation.row(2);
    let at = |z: f64| (scene.camera.position + axis * z).as_vec3().to_array();
    let (near, nearer, far) = (at(1.0), at(0.9), at(9.0));
    for place in [near, nearer] {
        append(&mut scene.splats, 0, |slots| {
            for (k, slot) in slots.iter_mut().enumerate() {
                let Some(slot) = slot else { continue };
                match k {
                    0..3 => **slot = place[k],
                    7..10 => **slot = 4.0,
                    10 => **slot = 15.0,
                    _ => {}
                }
            }
        });
    }
    let count = scene.splats.len();
    let clean = step(&gpu, &scene);
    let mut more = scene.clone();
    append(&mut more.splats, 3, |slots| {
        for (slot, x) in slots.iter_mut().zip(far) {
            if let Some(slot) = slot {
                **slot = x;
            }
        }
    });
    assert_unseen("behind the wall", &step(&gpu, &more), &clean, count);
}

#[test]
fn the_order_of_splats_does_not_matter() {
    let gpu = device::gpu();
    let scene = scenes::gentle(58, 50, 40, 33, 1);
    let clean = step(&gpu, &scene);
    let order = scenes::Random::new(1).permutation(50);
    let mut shuffled = scene.clone();
    let stride = scene.splats.sh_stride();
    for (to, &from) in order.iter().enumerate() {
        shuffled.splats.mean[to] = scene.splats.mean[from];
        shuffled.splats.quaternion[to] = scene.splats.quaternion[from];
        shuffled.splats.log_scale[to] = scene.splats.log_scale[from];
        shuffled.splats.opacity_logit[to] = scene.splats.opacity_logit[from];
        let sh = &scene.splats.sh[from * stride..][..stride];
        shuffled.splats.sh[to * stride..][..stride].copy_from_slice(sh);
    }
    let found = step(&gpu, &shuffled);
    assert!(found.image == clean.image, "the image changed");
    for (plane, was) in found.gradients.iter().zip(&clean.gradients) {
        for (to, &from) in order.iter().enumerate() {
            assert_eq!(plane[to], was[from], "splat {from}");
        }
    }
}

#[test]
fn the_length_of_a_quaternion_does_not_matter_and_has_no_gradient() {
    let gpu = device::gpu();
    let scene = scenes::gentle(62, 40, 40, 33, 0);
    let clean = step(&gpu, &scene);
    for factor in [-1.0f32, 2f32.powi(20), -2f32.powi(-20)] {
        let mut scaled = scene.clone();
        for q in scaled.splats.quaternion.iter_mut().flatten() {
            *q *= factor;
        }
        let found = step(&gpu, &scaled);
        // Multiplying by powers of two rounds nothing.
        assert!(found.image == clean.image, "{factor}: the image changed");
        for (now, was) in found.gradients[1].iter().zip(&clean.gradients[1]) {
            assert_eq!(now.map(|g| g * factor), *was, "{factor}: the gradient");
        }
    }
    // Euler's identity: 8 roundings of the terms.
    for (q, g) in scene.splats.quaternion.iter().zip(&clean.gradients[1]) {
        let wide = |v: &[f32; 4]| v.map(f64::from);
        let (q, g) = (wide(q), wide(g));
        let dot: f64 = q.iter().zip(g).map(|(q, g)| q * g).sum();
        let size: f64 = q.iter().zip(g).map(|(q, g)| (q * g).abs()).sum();
        // The gradient is a difference of terms that are rarely more than a hundred times larger.
        assert!(dot.abs() <= 1e-4 * size, "{dot:e} of {size:e}");
    }
}

#[test]
fn the_unit_of_the_world_does_not_matter() {
    let gpu = device::gpu();
    let scene = scenes::gentle(63, 40, 40, 33, 1);
    let clean = step(&gpu, &scene);
    let factor = 64.0;
    let mut scaled = scene.clone();
    scaled.camera.position *= factor;
    scaled.options.near *= factor;
    for x in scaled.splats.mean.iter_mut().flatten() {
        *x *= factor as f32;
    }
    for x in scaled.splats.log_scale.iter_mut().flatten() {
        *x += (factor as f32).ln();
    }
    let found = step(&gpu, &scaled);
    // Only the log-scales round: half an ULP of numbers up to 8 is a relative 2.4e-7 of a scale, and the exponential
    // adds as much for the rounding of its argument.
    for (now, was) in found.image.iter().zip(&clean.image) {
        assert!((now - was).abs() < 4e-6, "{now} was {was}");
    }
}

#[test]
fn poison_stays_where_it_is() {
    let gpu = device::gpu();
    let scene = scenes::gentle(59, 20, 33, 20, 1);
    let count = scene.splats.len();
    let clean = step(&gpu, &scene);
    let slots = 11 + scene.splats.sh_stride();
    for poison in scenes::POISON {
        let mut poisoned = scene.clone();
        for slot in 0..slots {
            append(&mut poisoned.splats, slot % count, |slots| {
                if let Some(Some(value)) = slots.get_mut(slot) {
                    **value = poison;
                }
            });
        }
        let found = step(&gpu, &poisoned);
        assert!(
            found.image.iter().all(|x| x.is_finite()),
            "{poison:e}: the image is not finite"
        );
        let sound = |plane: &Vec<[f32; 4]>| plane[..count].iter().flatten().all(|x| x.is_finite());
        assert!(
            found.after.params.iter().all(sound),
            "{poison:e}: a neighbour is not finite afterwards"
        );
        assert!(found.report.loss.is_finite(), "{poison:e}: the loss");
        assert!(
            found.gradients.iter().all(sound),
            "{poison:e}: a neighbour's gradient is not finite"
        );
        if !poison.is_finite() {
            assert!(found.image == clean.image, "{poison:e}: the image changed");
            let neighbours = bits(&found.gradients, count) == bits(&clean.gradients, count);
            assert!(neighbours, "{poison:e}: a neighbour's gradient changed");
        }
    }
}

#[test]
fn a_step_with_dropout_is_a_step_of_fewer_and_more_opaque_splats() {
    let gpu = device::gpu();
    let mut scene = scenes::gentle(61, 60, 48, 40, 1);
    // Opacities stay below 1.
    scene
        .splats
        .opacity_logit
        .iter_mut()
        .for_each(|logit| *logit = logit.min(-1.0));
    let with_dropout = TrainConfig {
        drop_rate: 0.5,
        ..config(&scene)
    };
    let [share, key] = schedule::dropout(&with_dropout, BEGUN + 1);
    let dropout = Dropout { share, key };
    let state = HostState::from_splats(&scene.splats, scene.splats.sh_degree);
    let found = step_by(&gpu, &scene, &state, with_dropout);
    let mut others = scene.clone();
    let opacity = |logit: f32| 1.0 / (1.0 + f64::from(-logit).exp());
    for (splat, logit) in others.splats.opacity_logit.iter_mut().enumerate() {
        let raised = opacity(*logit) * dropout.factor();
        *logit = match dropout.drops(splat as u32) {
            true => -20.0,
            false => (raised / (1.0 - raised)).ln() as f32,
        };
    }
    let dropped = others
        .splats
        .opacity_logit
        .iter()
        .filter(|&&logit| logit == -20.0)
        .count();
    assert!((10..30).contains(&dropped), "{dropped} of 60 splats are dropped");
    let expected = step(&gpu, &others);
    let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-4 * scale;
    for (a, b) in found.image.iter().zip(&expected.image) {
        assert!(near(f64::from(*a), f64::from(*b), 1.0), "a pixel is {a}, not {b}");
    }
    for (plane, (found, expected)) in found.gradients.iter().zip(&expected.gradients).enumerate() {
        let largest = expected.iter().flatten().fold(0.0_f32, |max, d| max.max(d.abs()));
        for (splat, (a, b)) in found.iter().zip(expected).enumerate() {
            // Derivative of the logarithm of an opacity by its logit: 1 - opacity.
            let [own, other] = [&scene, &others].map(|scene| 1.0 - opacity(scene.splats.opacity_logit[splat]));
            for lane in 0..4 {
                let factor = if (plane, lane) == (0, 3) { own / other } else { 1.0 };
                let (a, b) = (f64::from(a[lane]), f64::from(b[lane]) * factor);
                assert!(
                    near(a, b, 10.0 * f64::from(largest)),
                    "splat {splat}, plane {plane}: {a}, not {b}"
                );
            }
        }
    }
}
