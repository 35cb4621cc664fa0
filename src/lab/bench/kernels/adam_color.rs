//! Case of `adam_color`: harmonics and moments, one number at a time.

use super::KernelCase;
use super::adam::{AdamInput, SH_RATES, STEP, correction, stepped};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::adam_color::{AdamColor, Bindings, Choice, Params};
use crate::lab::bench::input::random::Random;
use crate::layout::{COLOR_STEPS, GEOMETRY_PLANES};
use crate::reference::sh;
use crate::render::plane_count;
use crate::scene::sh_coefficient_count;

/// Harmonics, moments and the factors of gradients.
pub struct AdamColorInput {
    /// Parameters and moments; gradients of the harmonics are products of the factors.
    pub adam: AdamInput,
    /// SH degree.
    pub sh_degree: u32,
    /// Camera centre of each step.
    positions: Vec<[f32; 3]>,
    /// dL/d colour, `[step][splat]`.
    d_colors: Vec<[f32; 3]>,
}

impl AdamColorInput {
    /// Random numbers, of so many steps.
    pub fn new(count: usize, stride: usize, sh_degree: u32, magnitude: f64, steps: usize) -> AdamColorInput {
        let planes = GEOMETRY_PLANES as usize..plane_count(sh_degree);
        let mut adam = AdamInput::new(count, stride, planes, magnitude);
        let random = &mut Random::new(count as u64 + 1);
        let three = |random: &mut Random, size: f64| [0; 3].map(|_| random.between(-size, size) as f32);
        // Splats lie within 2 of the origin along each axis.
        let positions: Vec<[f32; 3]> = (0..steps)
            .map(|_| [0; 3].map(|_| (4.0 + random.between(0.0, 4.0)) as f32))
            .collect();
        let d_colors: Vec<[f32; 3]> = (0..steps * stride).map(|_| three(random, magnitude)).collect();
        let mut gradients: Vec<_> = (0..steps)
            .map(|step| {
                let mut vectors = adam.vectors[1].clone();
                for splat in 0..stride {
                    let offset: [f64; 3] = std::array::from_fn(|axis| {
                        f64::from(adam.vectors[0][splat][axis]) - f64::from(positions[step][axis])
                    });
                    let length = offset.iter().map(|v| v * v).sum::<f64>().sqrt();
                    let basis = sh::basis(sh_degree, offset.map(|v| v / length));
                    let d_color = d_colors[step * stride + splat].map(f64::from);
                    for k in 0..4 * (plane_count(sh_degree) - GEOMETRY_PLANES as usize) {
                        let is_used = k < 3 * sh_coefficient_count(sh_degree);
                        let gradient = if is_used { basis[k / 3] * d_color[k % 3] } else { 0.0 };
                        vectors[(GEOMETRY_PLANES as usize + k / 4) * stride + splat][k % 4] = gradient as f32;
                    }
                }
                vectors
            })
            .collect();
        adam.vectors[1] = gradients.pop().unwrap_or_default();
        adam.earlier = gradients;
        adam.look_ahead = 0.25 * (steps as f32 - 1.0);
        AdamColorInput {
            adam,
            sh_degree,
            positions,
            d_colors,
        }
    }
}

/// Steps for `count` splats of degree 3, as many as training takes at a time.
pub fn usual<'a>(gpu: &Gpu, count: usize) -> Result<KernelCase<'a, AdamColor>> {
    adam_color(gpu, AdamColorInput::new(count, count, 3, 1.0, COLOR_STEPS as usize))
}

/// All steps.
pub fn adam_color<'a>(gpu: &Gpu, input: AdamColorInput) -> Result<KernelCase<'a, AdamColor>> {
    let d_colors = gpu.buffer_from("factors", &input.d_colors)?;
    let (p, degree, steps) = (input.adam.params(), input.sh_degree, input.positions.len());
    let back = |i: usize| input.positions[steps - 1 - i.min(steps - 1)];
    let params = Params {
        splat_count: p.splat_count,
        stride: p.stride,
        step_count: steps as u32,
        rate_sh_dc: SH_RATES[0],
        rate_sh_rest: SH_RATES[1],
        beta1: p.beta1,
        beta2: p.beta2,
        epsilon: p.epsilon,
        position: std::array::from_fn(back),
        correction1: std::array::from_fn(|i| correction(p.beta1, STEP - i as i32)),
        correction2: [STEP - steps as i32, STEP].map(|step| correction(p.beta2, step)),
        look_ahead: [input.adam.look_ahead; 2],
    };
    // Eight roundings of a basis function's terms, whose magnitudes add up to 3 at most, are 24u of a gradient, and
    // four of the direction, by which it changes 7 times as fast, another 28u. Four gradients enter the moment with
    // 0.35 of that, beside two roundings of each sum and 4u of the moment's own.
    let (case, buffers) = stepped(gpu, input.adam, 31.0)?;
    let case = case.commands(move |rec, kernel: &AdamColor, _| {
        let io = Bindings {
            counts: &buffers.counts,
            d_colors: &d_colors,
            params: &buffers.params,
            moment1: &buffers.moment1,
            moment2: &buffers.moment2,
        };
        kernel.record(rec, io, params, kernel.groups(params.splat_count as usize));
    });
    Ok(case.tune(move |choice: &mut Choice| choice.spec.sh_degree = degree))
}
