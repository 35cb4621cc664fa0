//! Case of `adam`: parameters and moments, one number at a time; `adam_color` shares its expectations.

use super::{KernelCase, counts, read, sample};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::Kernel;
use crate::kernels::adam::{Adam, Bindings, Params};
use crate::lab::bench::Work;
use crate::lab::bench::check::Output;
use crate::lab::bench::input::random::Random;
use crate::layout::{COUNT_FAILED, COUNT_POISONED, COUNT_POISONED_FIRST, GEOMETRY_PLANES};
use crate::reference::adam::{self as reference, AdamState};
use std::ops::Range;
use std::rc::Rc;

/// Vectors that are compared.
const SAMPLES: usize = 5000;
/// The step, on which Adam's corrections depend.
pub(super) const STEP: i32 = 7;
/// Number of the step among those whose gradients of colours wait.
const COLOR_STEP: u32 = 2;
/// Number of the first splat.
pub(super) const FIRST_SPLAT: u32 = 1000;

/// Learning rates of harmonics of degree 0 and of the others.
pub(super) const SH_RATES: [f32; 2] = [2.5e-3, 1.25e-4];

/// Parameters, gradients and both moments of some splats, `[plane][splat]`.
pub struct AdamInput {
    /// Splats.
    pub count: usize,
    /// Vectors of a plane, of which the last ones belong to no splat.
    pub stride: usize,
    /// Planes that the kernel steps; those before are left alone.
    pub planes: Range<usize>,
    /// Size of the gradients.
    pub magnitude: f64,
    /// Largest log-ratio of scales; 0: no bound.
    pub log_aspect_max: f32,
    /// Whether the frame failed.
    pub failed: bool,
    /// Parameters, gradients, first and second moments. Gradients of colours are those of the first plane.
    pub vectors: [Vec<[f32; 4]>; 4],
    /// Gradients of earlier steps that are taken at the same time, from the first.
    pub earlier: Vec<Vec<[f32; 4]>>,
    /// First moments by which parameters lie ahead.
    pub look_ahead: f32,
}

impl AdamInput {
    /// Random numbers; now and then there is no gradient at all.
    pub fn new(count: usize, stride: usize, planes: Range<usize>, magnitude: f64) -> AdamInput {
        let random = &mut Random::new(count as u64);
        let mut four = |low: f64, high: f64| [0; 4].map(|_| random.between(low, high) as f32);
        let square = magnitude * magnitude;
        let mut vectors = [(); 4].map(|()| Vec::new());
        for i in 0..stride * planes.end {
            vectors[0].push(four(-2.0, 2.0));
            let gradient = four(-magnitude, magnitude);
            vectors[1].push(if i % 11 == 5 { [0.0; 4] } else { gradient });
            vectors[2].push(four(-magnitude, magnitude));
            vectors[3].push(four(0.01 * square, square));
        }
        AdamInput {
            count,
            stride,
            planes,
            magnitude,
            log_aspect_max: 0.0,
            failed: false,
            vectors,
            earlier: Vec::new(),
            look_ahead: 0.0,
        }
    }

    pub(super) fn params(&self) -> Params {
        Params {
            first_splat: FIRST_SPLAT,
            splat_count: self.count as u32,
            stride: self.stride as u32,
            rate_mean: 1.6e-4,
            rate_opacity: 0.05,
            rate_quaternion: 1e-3,
            rate_log_scale: 5e-3,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-15,
            correction1: correction(0.9, STEP),
            correction2: correction(0.999, STEP),
            log_aspect_max: self.log_aspect_max,
            color_step: COLOR_STEP,
        }
    }

    fn is_stepped(&self, i: usize) -> bool {
        i % self.stride < self.count && self.planes.contains(&(i / self.stride)) && !self.failed
    }

    /// Whether a vector's gradient is left out, its squares being no numbers.
    fn is_poisoned(&self, i: usize) -> bool {
        self.is_stepped(i) && self.vectors[1][i].iter().any(|g| !(g * g).is_finite())
    }

    /// dL/d colour of a splat, and whether it is put aside as it is; else zeros are.
    fn color(&self, splat: usize) -> ([f32; 3], bool) {
        let [r, g, b, _] = self.vectors[1][splat];
        let color = [r, g, b];
        (color, color.iter().all(|d| (8.0 * d * d).is_finite()))
    }

    /// Splats whose colours are put aside as zeros.
    fn poisoned_colors(&self) -> impl Iterator<Item = usize> {
        let has_colors = self.planes.contains(&0) && !self.failed;
        let splats = 0..if has_colors { self.count } else { 0 };
        splats.filter(|&splat| !self.color(splat).1)
    }

    /// Parameters and moments of a vector after the step.
    fn expected(&self, i: usize) -> [[f64; 4]; 3] {
        let [values, gradients, first, second] = &self.vectors;
        let plane = i / self.stride;
        if !self.is_stepped(i) || self.is_poisoned(i) {
            return [values, first, second].map(|list| list[i].map(f64::from));
        }
        let p = self.params();
        let adam = reference::Adam {
            beta1: f64::from(p.beta1),
            beta2: f64::from(p.beta2),
            epsilon: f64::from(p.epsilon),
        };
        let step = |lane: usize| {
            let state = AdamState {
                value: f64::from(values[i][lane]),
                first: f64::from(first[i][lane]),
                second: f64::from(second[i][lane]),
            };
            let rate = f64::from(rate(&p, plane, lane));
            let all = self.earlier.iter().chain([gradients]);
            let gradients: Vec<f64> = all.map(|step| f64::from(step[i][lane])).collect();
            adam.steps(state, &gradients, rate, STEP, f64::from(self.look_ahead))
        };
        let mut next = [0, 1, 2, 3].map(step);
        if plane == 1 {
            let norm = next.iter().map(|s| s.value * s.value).sum::<f64>().sqrt();
            next.iter_mut().for_each(|s| s.value /= norm);
        }
        if plane == 2 && self.log_aspect_max > 0.0 {
            let moved = [0, 1, 2].map(|lane: usize| next[lane].value);
            let moved = reference::bounded(moved, f64::from(self.log_aspect_max));
            next.iter_mut().zip(moved).for_each(|(s, x)| s.value = x);
        }
        [next.map(|s| s.value), next.map(|s| s.first), next.map(|s| s.second)]
    }
}

/// Adam's bias correction of a moment after a step.
pub(super) fn correction(beta: f32, step: i32) -> f32 {
    (1.0 / (1.0 - f64::from(beta).powi(step))) as f32
}

/// The learning rate of one lane of a plane.
fn rate(p: &Params, plane: usize, lane: usize) -> f32 {
    match (plane, lane) {
        (0, 0..3) => p.rate_mean,
        (0, _) => p.rate_opacity,
        (1, _) => p.rate_quaternion,
        (2, 0..3) => p.rate_log_scale,
        (2, _) => 0.0,
        (3, 0..3) => SH_RATES[0],
        _ => SH_RATES[1],
    }
}

/// Splats of degree 3.
pub fn usual<'a>(gpu: &Gpu, count: usize) -> Result<KernelCase<'a, Adam>> {
    adam(gpu, AdamInput::new(count, count, 0..GEOMETRY_PLANES as usize, 1.0))
}

/// Buffers of a step.
pub(super) struct AdamBuffers {
    pub(super) counts: Buffer<u32>,
    pub(super) params: Buffer<[f32; 4]>,
    pub(super) moment1: Buffer<[f32; 4]>,
    pub(super) moment2: Buffer<[f32; 4]>,
}

/// One step.
pub fn adam<'a>(gpu: &Gpu, input: AdamInput) -> Result<KernelCase<'a, Adam>> {
    let stride = input.stride;
    let gradients = [&input.vectors[1][..], &input.vectors[1][..stride]].concat();
    let d_params = gpu.buffer_from("before", &gradients)?;
    let (params, rows) = (input.params(), 1 + input.planes.len() as u32);
    let begin = COLOR_STEP as usize * stride;
    let colors_before = gpu.buffer_from("before", &vec![[f32::NAN; 3]; begin + stride])?;
    let d_colors = gpu.buffer::<[f32; 3]>("after", begin + stride)?;
    let is_written = |splat: &usize| *splat < input.count && !input.failed;
    let expected: Vec<f64> = (0..stride)
        .filter(is_written)
        .map(|splat| input.color(splat))
        .flat_map(|(color, is_sound)| color.map(|d| if is_sound { f64::from(d) } else { 0.0 }))
        .collect();
    // A moment is two products and a sum of terms up to the gradients' magnitude: 4u of it.
    let (case, buffers) = stepped(gpu, input, 4.0)?;
    let written = expected.len() / 3;
    let case = case.copy(&colors_before, &d_colors).compare(&d_colors, move |after| {
        let found = after[begin..begin + written]
            .as_flattened()
            .iter()
            .map(|&d| f64::from(d));
        vec![Output::exact("colours", found.collect(), expected.clone())]
    });
    Ok(case.commands(move |rec, kernel: &Adam, _| {
        let io = Bindings {
            counts: &buffers.counts,
            d_params: &d_params,
            params: &buffers.params,
            moment1: &buffers.moment1,
            moment2: &buffers.moment2,
            d_colors: &d_colors,
        };
        let row = params.splat_count.div_ceil(kernel.workgroup);
        kernel.record(rec, io, params, Groups::Grid([row, rows, 1]));
    }))
}

/// Case without commands: buffers before the step and expectations after it, with the error of the first moment in
/// units of 2⁻²⁴.
pub(super) fn stepped<'a, K: Kernel>(
    gpu: &Gpu,
    input: AdamInput,
    moment_error: f64,
) -> Result<(KernelCase<'a, K>, AdamBuffers)> {
    let vectors = input.planes.end * input.stride;
    let upload = |i: usize| gpu.buffer_from("before", &input.vectors[i]);
    let [values, first, second] = [upload(0)?, upload(2)?, upload(3)?];
    let [params, moment1, moment2] = [(); 3].map(|()| gpu.buffer::<[f32; 4]>("after", vectors));
    let buffers = AdamBuffers {
        counts: counts(gpu, &[])?,
        params: params?,
        moment1: moment1?,
        moment2: moment2?,
    };
    let counts_before = counts(gpu, &[(COUNT_FAILED, input.failed.into())])?;
    // Seven times each parameter: the gradient read, the others read and written.
    let work = Work::of(input.count, "splats").moving(7 * 16 * input.planes.len() * input.count);
    // The second moment adds one factor. The step is a quotient of those, about 12u, and far smaller than its
    // parameter; the norm of a quaternion that happens to be short adds as much again.
    let (u, magnitude, input) = (2f64.powi(-24), input.magnitude, Rc::new(input));
    let mut case = KernelCase::new(work).copy(&counts_before, &buffers.counts);
    for (k, (name, before, after, tolerance, scale)) in [
        ("parameters", &values, &buffers.params, 16.0 * u, 1.0),
        ("moment1", &first, &buffers.moment1, moment_error * u, magnitude),
        (
            "moment2",
            &second,
            &buffers.moment2,
            (moment_error + 1.0) * u,
            magnitude * magnitude,
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let input = input.clone();
        let judged = case.compare(after, move |after| {
            let [mut found, mut expected] = [(); 2].map(|()| Vec::new());
            for i in sample(vectors, SAMPLES) {
                found.extend(after[i].map(f64::from));
                expected.extend(input.expected(i)[k]);
            }
            vec![Output::relative(name, found, expected, tolerance, scale)]
        });
        case = judged.copy(before, after);
    }
    let counts = buffers.counts.clone();
    let case = case.judge(move |gpu| {
        let counts = read(gpu, &counts)?;
        let poisoned = (0..vectors).filter(|&i| input.is_poisoned(i));
        let poisoned: Vec<usize> = poisoned.chain(input.poisoned_colors()).collect();
        let first = poisoned.iter().map(|i| FIRST_SPLAT + (i % input.stride) as u32).min();
        // The slot counts down from the top, 0 being none.
        let first = first.map_or(0, |splat| u32::MAX - splat);
        let slots = [COUNT_POISONED, COUNT_POISONED_FIRST].map(|slot| counts[slot as usize]);
        let wanted = vec![poisoned.len() as f64, f64::from(first)];
        Ok(vec![Output::exact("poisoned", slots.map(f64::from).into(), wanted)])
    });
    Ok((case, buffers))
}
