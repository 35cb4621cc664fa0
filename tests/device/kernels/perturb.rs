//! Exploration noise: random numbers and covariance.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::{self, POISON, Random};
use crate::kernels::fitting;
use crate::kernels::supported;
use ashfall::kernels::perturb::{Bindings, Choice, Params, Perturb, Spec};
use ashfall::layout::COUNT_FAILED;
use ashfall::reference::Splat;
use ashfall::reference::perturb::{normals, perturb};
use ashfall::render::planes_from_splats;

const SEED: u32 = 0xdead_beef;
const STEP: u32 = 12_345;
/// The number of the first splat.
const FIRST: u32 = 262_144;
const AMPLITUDE: f32 = 40.0;

/// Splats whose opacity lies around the one at which the noise fades.
fn splats(count: usize) -> scenes::Scene {
    let mut scene = scenes::gentle(count as u64, count, 64, 64, 0);
    let random = &mut Random::new(9);
    for logit in &mut scene.splats.opacity_logit {
        *logit = random.between(-9.0, -3.0) as f32;
    }
    for scale in scene.splats.log_scale.iter_mut().flatten() {
        *scale = random.between(-4.0, -1.0) as f32;
    }
    scene
}

#[test]
fn means_move_by_noise_of_their_splats_shape() {
    let gpu = device::gpu();
    let mut check = Check::new("perturb");
    for variant in supported!(perturb, gpu) {
        for workgroup in fitting(&gpu, [8, 64, 256]) {
            let spec = Spec { workgroup };
            let kernel = Perturb::new(&gpu, Choice { variant, spec }).unwrap();
            for (name, count, failed) in [
                ("nothing to move", 0, 0),
                ("one", 1, 0),
                ("2^6 + 1", 65, 0),
                ("crosses workgroups", 3000, 0),
                ("the frame failed", 30, 1),
            ] {
                let scene = splats(count);
                let mut before = planes_from_splats(&scene.splats);
                // Poisoned splats must not be moved, nor anything beside them.
                for (i, poison) in POISON.iter().enumerate().filter(|_| count > 1000) {
                    before[(i % 3) * count + 50 * i][i % 4] = *poison;
                }
                let values = buffer(&gpu, &before);
                let io = Bindings {
                    counts: &counts(&gpu, &[(COUNT_FAILED, failed)]),
                    params: &values,
                    splat_from_slot: &buffer(&gpu, &[u32::MAX]),
                };
                let params = Params {
                    first_splat: FIRST,
                    splat_count: count as u32,
                    stride: count as u32,
                    seed: SEED,
                    step: STEP,
                    amplitude: AMPLITUDE,
                    indexed: 0,
                };
                gpu.run(|rec| kernel.record(rec, io, params, kernel.groups(count)))
                    .unwrap();
                let after = read(&gpu, &values)[..before.len()].to_vec();
                let mut expected = floats(&before);
                for i in (0..count).filter(|_| failed == 0) {
                    let poisoned = count > 1000 && i % 50 == 0 && i / 50 < POISON.len();
                    if poisoned {
                        // Whatever a poisoned splat does, it concerns nobody else.
                        for lane in 0..4 {
                            expected[4 * i + lane] = f64::from(after[i][lane]);
                        }
                        assert!(
                            before[i].iter().any(|x| !x.is_finite())
                                || after[i].iter().all(|x| x.is_finite())
                        );
                        continue;
                    }
                    let s = Splat::<f64>::of(&scene.splats, i);
                    let xi = normals(SEED, STEP, FIRST + i as u32);
                    let strength = f64::from(AMPLITUDE);
                    let (rotation, scale) = (s.quaternion, s.log_scale);
                    let mean = perturb(s.mean, rotation, scale, s.opacity_logit, xi, strength);
                    expected[4 * i..4 * i + 3].copy_from_slice(&mean);
                }
                // Noise is of size one here. The Vulkan specification grants the logarithm an absolute error of
                // 2^-21 near 1 and 3 ULP elsewhere; its square root multiplies what is small, where the noise is
                // small too: 2^-21 / (2 * 2^-11) at a radius of 2^-11, below which no draw falls; and as much
                // again for sine and cosine (2^-11 absolutely, by the specification; far less on any device).
                let found = floats(&after);
                check.outputs(
                    name,
                    vec![Output::relative("means", found, expected, 1e-4, 1.0)],
                );
            }
        }
    }
    check.finish();
}

#[test]
fn slots_may_lie_in_any_order() {
    let gpu = device::gpu();
    let kernel = Perturb::new(&gpu, Choice::default()).unwrap();
    let scene = splats(270);
    let planes = planes_from_splats(&scene.splats);
    let index = scenes::shuffled(270);
    let run = |planes: &[[f32; 4]], indexed| {
        let values = buffer(&gpu, planes);
        let io = Bindings {
            counts: &counts(&gpu, &[(COUNT_FAILED, 0)]),
            params: &values,
            splat_from_slot: &buffer(&gpu, &index),
        };
        let params = Params {
            splat_count: 270,
            stride: 270,
            seed: SEED,
            step: STEP,
            amplitude: AMPLITUDE,
            indexed,
            ..Params::default()
        };
        gpu.run(|rec| kernel.record(rec, io, params, kernel.groups(270)))
            .unwrap();
        read(&gpu, &values)[..planes.len()].to_vec()
    };
    let ordered = scenes::in_order(&run(&planes, 0), &index);
    let moved = scenes::in_order(&planes, &index);
    assert_eq!(run(&moved, 1), ordered);
    assert_ne!(run(&moved, 0), ordered, "the order makes no difference");
}
