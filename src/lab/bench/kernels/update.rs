//! What a step does to the parameters: Adam, and MCMC's noise.

use super::{ELEMENTWISE, counts, read, sample, sizes, wanted};
use crate::Result;
use crate::gpu::Groups;
use crate::kernels::{adam, perturb};
use crate::lab::bench::check::Output;
use crate::lab::bench::input::random::Random;
use crate::lab::bench::input::scene::scattered;
use crate::lab::bench::{Bench, Unit, Work};
use crate::reference::Splat;
use crate::reference::adam::{Adam, State};
use crate::reference::perturb::{normals, perturb};
use crate::render::{plane_count, planes_from_splats};

/// Degree of the harmonics.
const DEGREE: u32 = 3;
/// Elements that are judged.
const SAMPLES: usize = 2000;
/// The step, which Adam's corrections depend on.
const STEP: i32 = 7;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for &count in sizes(bench.gpu().caps()) {
        step(bench, count)?;
        move_about(bench, count)?;
    }
    Ok(())
}

fn params(count: usize) -> adam::Params {
    let correction = |beta: f32| (1.0 / (1.0 - f64::from(beta).powi(STEP))) as f32;
    adam::Params {
        splat_count: count as u32,
        stride: count as u32,
        rate_mean: 1.6e-4,
        rate_opacity: 0.05,
        rate_quaternion: 1e-3,
        rate_log_scale: 5e-3,
        rate_sh_dc: 2.5e-3,
        rate_sh_rest: 1.25e-4,
        beta1: 0.9,
        beta2: 0.999,
        epsilon: 1e-15,
        correction1: correction(0.9),
        correction2: correction(0.999),
        // From the first splat on, and without bounds.
        ..adam::Params::default()
    }
}

/// The learning rate of one lane of a plane.
fn rate(p: &adam::Params, plane: usize, lane: usize) -> f32 {
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

/// Parameters, gradients, first and second moments.
type Planes = [Vec<[f32; 4]>; 4];

fn step(bench: &mut Bench, count: usize) -> Result<()> {
    let gpu = bench.gpu().clone();
    let planes = plane_count(DEGREE);
    // Seven times each parameter: the gradient read, the others read and written.
    let work = Work::of(count, Unit::Splats).moving(7 * 16 * planes * count);
    let choices = wanted!(bench, adam, count, ELEMENTWISE, work);
    if choices.is_empty() {
        return Ok(());
    }
    let random = &mut Random::new(count as u64);
    let mut four = |low: f64, high: f64| [0; 4].map(|_| random.between(low, high) as f32);
    let ranges = [(-2.0, 2.0), (-1.0, 1.0), (-1.0, 1.0), (0.01, 1.0)];
    let before: Planes =
        ranges.map(|(low, high)| (0..planes * count).map(|_| four(low, high)).collect());
    let upload = |i: usize| gpu.buffer_from("before", &before[i]);
    let [values, gradients, first, second] = [upload(0)?, upload(1)?, upload(2)?, upload(3)?];
    let counts = counts(&gpu, &[])?;
    let [value, moment1, moment2] = [(); 3].map(|()| gpu.buffer("after", planes * count));
    let (value, moment1, moment2) = (value?, moment1?, moment2?);
    for (variant, workgroup, case) in choices {
        let spec = adam::Spec { workgroup };
        let kernel = adam::Adam::new(&gpu, adam::Choice { variant, spec })?;
        let io = adam::Bindings {
            counts: &counts,
            d_params: &gradients,
            params: &value,
            moment1: &moment1,
            moment2: &moment2,
        };
        let row = (count as u32).div_ceil(workgroup);
        let groups = Groups::Grid([row, planes as u32, 1]);
        bench.trial(
            &case,
            |rec| {
                let all = 0..planes * count;
                rec.copy(&values, all.clone(), &value, 0);
                rec.copy(&first, all.clone(), &moment1, 0);
                rec.copy(&second, all, &moment2, 0);
            },
            |rec| kernel.record(rec, io, params(count), groups),
            || {
                let after = [
                    read(&gpu, &value)?,
                    read(&gpu, &moment1)?,
                    read(&gpu, &moment2)?,
                ];
                Ok(stepped(&before, &after, count))
            },
        )?;
    }
    Ok(())
}

/// Tolerances are those of the kernel's test, which derives them.
fn stepped(before: &Planes, after: &[Vec<[f32; 4]>; 3], count: usize) -> Vec<Output> {
    let p = params(count);
    let oracle = Adam {
        beta1: f64::from(p.beta1),
        beta2: f64::from(p.beta2),
        epsilon: f64::from(p.epsilon),
    };
    let [mut found, mut expected] = [(); 2].map(|()| [(); 3].map(|()| Vec::new()));
    for i in sample(before[0].len(), SAMPLES) {
        let plane = i / count;
        let mut next = [0, 1, 2, 3].map(|lane| {
            let [value, gradient, first, second] =
                [0, 1, 2, 3].map(|list: usize| f64::from(before[list][i][lane]));
            let state = State {
                value,
                first,
                second,
            };
            oracle.step(state, gradient, f64::from(rate(&p, plane, lane)), STEP)
        });
        if plane == 1 {
            let norm = next.iter().map(|s| s.value * s.value).sum::<f64>().sqrt();
            next.iter_mut().for_each(|s| s.value /= norm);
        }
        for (list, values) in found.iter_mut().enumerate() {
            values.extend(after[list][i].map(f64::from));
        }
        expected[0].extend(next.map(|s| s.value));
        expected[1].extend(next.map(|s| s.first));
        expected[2].extend(next.map(|s| s.second));
    }
    let u = 2f64.powi(-24);
    let bounds = [("parameters", 16.0), ("moment1", 4.0), ("moment2", 5.0)];
    let columns = found.into_iter().zip(expected).zip(bounds);
    columns
        .map(|((f, e), (name, units))| Output::relative(name, f, e, units * u, 1.0))
        .collect()
}

fn move_about(bench: &mut Bench, count: usize) -> Result<()> {
    let gpu = bench.gpu().clone();
    // Three planes in, one out.
    let work = Work::of(count, Unit::Splats).moving(64 * count);
    let choices = wanted!(bench, perturb, count, ELEMENTWISE, work);
    if choices.is_empty() {
        return Ok(());
    }
    let mut scene = scattered(count, [960, 540], 3.0, 0);
    let random = &mut Random::new(9);
    for logit in &mut scene.splats.opacity_logit {
        *logit = random.between(-9.0, -3.0) as f32;
    }
    for scale in scene.splats.log_scale.iter_mut().flatten() {
        *scale = random.between(-4.0, -1.0) as f32;
    }
    let planes = planes_from_splats(&scene.splats);
    let before = gpu.buffer_from("before", &planes)?;
    let values = gpu.buffer("params", planes.len())?;
    let counts = counts(&gpu, &[])?;
    let index = gpu.buffer("splat_from_slot", 1)?;
    let params = perturb::Params {
        splat_count: count as u32,
        stride: count as u32,
        seed: 0xdead_beef,
        step: 12_345,
        amplitude: 40.0,
        ..perturb::Params::default()
    };
    for (variant, workgroup, case) in choices {
        let spec = perturb::Spec { workgroup };
        let kernel = perturb::Perturb::new(&gpu, perturb::Choice { variant, spec })?;
        let io = perturb::Bindings {
            counts: &counts,
            params: &values,
            splat_from_slot: &index,
        };
        bench.trial(
            &case,
            |rec| rec.copy(&before, 0..planes.len(), &values, 0),
            |rec| kernel.record(rec, io, params, kernel.groups(count)),
            || {
                let after = read(&gpu, &values)?;
                let (mut found, mut expected) = (Vec::new(), Vec::new());
                for i in sample(count, SAMPLES) {
                    let s = Splat::<f64>::of(&scene.splats, i);
                    let xi = normals(params.seed, params.step, i as u32);
                    let strength = f64::from(params.amplitude);
                    let (rotation, scale) = (s.quaternion, s.log_scale);
                    let mean = perturb(s.mean, rotation, scale, s.opacity_logit, xi, strength);
                    found.extend(after[i][..3].iter().map(|&x| f64::from(x)));
                    expected.extend(mean);
                }
                Ok(vec![Output::relative("means", found, expected, 1e-4, 1.0)])
            },
        )?;
    }
    Ok(())
}
