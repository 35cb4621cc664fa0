//! Adam step of every parameter, against the oracle.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::Random;
use crate::kernels::fitting;
use crate::kernels::supported;
use ashfall::gpu::Groups;
use ashfall::kernels::adam::{Adam, Bindings, Choice, Params, Spec};
use ashfall::layout::{COUNT_FAILED, COUNT_POISONED, COUNT_POISONED_FIRST};
use ashfall::reference::adam::{self, State};

const PLANES: usize = 5;
const STEP: i32 = 7;
const BETAS: [f32; 2] = [0.9, 0.999];

fn params(splat_count: usize, stride: usize) -> Params {
    let correction = |beta: f32| (1.0 / (1.0 - f64::from(beta).powi(STEP))) as f32;
    Params {
        first_splat: 1000,
        splat_count: splat_count as u32,
        stride: stride as u32,
        rate_mean: 1.6e-4,
        rate_opacity: 0.05,
        rate_quaternion: 1e-3,
        rate_log_scale: 5e-3,
        rate_sh_dc: 2.5e-3,
        rate_sh_rest: 1.25e-4,
        beta1: BETAS[0],
        beta2: BETAS[1],
        epsilon: 1e-15,
        correction1: correction(BETAS[0]),
        correction2: correction(BETAS[1]),
        log_aspect_max: 0.0,
    }
}

/// The learning rate of one lane of a plane.
fn rate(p: &Params, plane: usize, lane: usize) -> f32 {
    match (plane, lane) {
        (0, 0..3) => p.rate_mean,
        (0, _) => p.rate_opacity,
        (1, _) => p.rate_quaternion,
        (2, 0..3) => p.rate_log_scale,
        (2, _) => 0.0,
        (3, 0..3) => p.rate_sh_dc,
        _ => p.rate_sh_rest,
    }
}

/// Parameters, gradients and both moments, `[plane][splat]`.
struct Input {
    log_aspect_max: f32,
    count: usize,
    stride: usize,
    failed: u32,
    planes: [Vec<[f32; 4]>; 4],
}

fn input(count: usize, magnitude: f64, poison: Option<f32>, failed: u32) -> Input {
    let stride = count + 3;
    let random = &mut Random::new(count as u64);
    let mut four = |low: f64, high: f64| [0; 4].map(|_| random.between(low, high) as f32);
    let mut planes = [(); 4].map(|()| Vec::new());
    for i in 0..stride * PLANES {
        planes[0].push(four(-2.0, 2.0));
        let mut gradient = four(-magnitude, magnitude);
        if let Some(value) = poison.filter(|_| i % 3 == 1) {
            gradient[i % 4] = value;
        }
        // No gradient at all now and then.
        planes[1].push(if i % 11 == 5 { [0.0; 4] } else { gradient });
        planes[2].push(four(-magnitude, magnitude));
        let square = magnitude * magnitude;
        planes[3].push(four(0.01 * square, square));
    }
    Input {
        log_aspect_max: 0.0,
        count,
        stride,
        failed,
        planes,
    }
}

/// What parameters and moments should be afterwards, how many gradients were poisoned, and the first splat of those.
fn expected(input: &Input) -> ([Vec<f64>; 3], u32, Option<u32>) {
    let p = params(input.count, input.stride);
    let adam = adam::Adam {
        beta1: f64::from(p.beta1),
        beta2: f64::from(p.beta2),
        epsilon: f64::from(p.epsilon),
    };
    let [values, gradients, first, second] = &input.planes;
    let mut after = [values, first, second].map(|plane| floats(plane));
    let (mut poisoned, mut first_poisoned) = (0, None);
    for i in 0..input.stride * PLANES {
        let (plane, splat) = (i / input.stride, i % input.stride);
        if splat >= input.count || input.failed != 0 {
            continue;
        }
        if gradients[i].iter().any(|g| !(g * g).is_finite()) {
            poisoned += 1;
            let number = p.first_splat + splat as u32;
            first_poisoned = Some(first_poisoned.unwrap_or(number).min(number));
            continue;
        }
        let step = |lane: usize| {
            let state = State {
                value: f64::from(values[i][lane]),
                first: f64::from(first[i][lane]),
                second: f64::from(second[i][lane]),
            };
            let rate = f64::from(rate(&p, plane, lane));
            adam.step(state, f64::from(gradients[i][lane]), rate, STEP)
        };
        let mut next = [0, 1, 2, 3].map(step);
        if plane == 1 {
            let norm = next.iter().map(|s| s.value * s.value).sum::<f64>().sqrt();
            next.iter_mut().for_each(|s| s.value /= norm);
        }
        if plane == 2 && input.log_aspect_max > 0.0 {
            let moved = [0, 1, 2].map(|lane: usize| next[lane].value);
            let moved = adam::bounded(moved, f64::from(input.log_aspect_max));
            next.iter_mut().zip(moved).for_each(|(s, x)| s.value = x);
        }
        for (lane, state) in next.iter().enumerate() {
            after[0][4 * i + lane] = state.value;
            after[1][4 * i + lane] = state.first;
            after[2][4 * i + lane] = state.second;
        }
    }
    (after, poisoned, first_poisoned)
}

#[test]
fn parameters_and_moments_step_together() {
    let gpu = device::gpu();
    let mut check = Check::new("adam");
    // The log-scales lie between -2 and 2: a bound of 1 moves most of them, one of 3.9 hardly any.
    let aspects = [("aspect 1", 1.0), ("aspect 3.9", 3.9)].map(|(name, most)| {
        (
            name,
            Input {
                log_aspect_max: most,
                ..input(200, 1.0, None, 0)
            },
        )
    });
    let cases = [
        ("nothing to update", 0, 1.0, None, 0),
        ("one", 1, 1.0, None, 0),
        ("2^6 + 1", 65, 1.0, None, 0),
        ("crosses workgroups", 1000, 1.0, None, 0),
        ("small gradients", 100, 1e-8, None, 0),
        ("large gradients", 100, 1e8, None, 0),
        ("NaN among gradients", 100, 1.0, Some(f32::NAN), 0),
        (
            "infinity among gradients",
            100,
            1.0,
            Some(f32::NEG_INFINITY),
            0,
        ),
        ("a square beyond all numbers", 100, 1.0, Some(-3e19), 0),
        ("the frame failed", 100, 1.0, None, 1),
    ]
    .map(|(name, count, size, poison, failed)| (name, size, input(count, size, poison, failed)));
    let aspects = aspects.map(|(name, input)| (name, 1.0, input));
    for variant in supported!(adam, gpu) {
        for workgroup in fitting(&gpu, [8, 64, 256]) {
            let spec = Spec { workgroup };
            let kernel = Adam::new(&gpu, Choice { variant, spec }).unwrap();
            for (name, magnitude, input) in cases.iter().chain(&aspects) {
                let magnitude = *magnitude;
                let [values, gradients, first, second] =
                    input.planes.each_ref().map(|plane| buffer(&gpu, plane));
                let counted = counts(&gpu, &[(COUNT_FAILED, input.failed)]);
                let io = Bindings {
                    counts: &counted,
                    d_params: &gradients,
                    params: &values,
                    moment1: &first,
                    moment2: &second,
                };
                let params = Params {
                    log_aspect_max: input.log_aspect_max,
                    ..params(input.count, input.stride)
                };
                let row = params.splat_count.div_ceil(workgroup);
                let groups = Groups::Grid([row, PLANES as u32, 1]);
                gpu.run(|rec| kernel.record(rec, io, params, groups))
                    .unwrap();
                let ([value, moment1, moment2], poisoned, first_poisoned) = expected(input);
                let found = |buffer| floats(&read(&gpu, buffer));
                let counted = read(&gpu, &counted);
                let [slot, first_slot] = [COUNT_POISONED, COUNT_POISONED_FIRST].map(|s| s as usize);
                let counted_first = match counted[first_slot] {
                    0 => None,
                    below_top => Some(u32::MAX - below_top),
                };
                assert_eq!(
                    counted_first, first_poisoned,
                    "{name}: the first poisoned splat"
                );
                let counted = counted[slot];
                // A moment is two products and a sum of terms up to the gradients' magnitude: 4u of it, and
                // the second adds one factor. The step is a quotient of those, about 12u, and far smaller
                // than its parameter; the norm of a quaternion that happens to be short adds as much again.
                let (u, square) = (2f64.powi(-24), magnitude * magnitude);
                check.outputs(
                    name,
                    vec![
                        Output::relative("parameters", found(&values), value, 16.0 * u, 1.0),
                        Output::relative("moment1", found(&first), moment1, 4.0 * u, magnitude),
                        Output::relative("moment2", found(&second), moment2, 5.0 * u, square),
                        Output::exact("poisoned", vec![counted.into()], vec![poisoned.into()]),
                    ],
                );
            }
        }
    }
    check.finish();
}
