//! Case of `adam_color`: harmonics and moments, one number at a time.

use super::KernelCase;
use super::adam::{AdamInput, SH_RATES, stepped};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::adam_color::{AdamColor, Bindings, Choice, Params};
use crate::lab::bench::input::random::Random;
use crate::layout::{D_COLOR_PLANE, DIRECTION_PLANE, GEOMETRY_PLANES, GRADIENT_PLANES};
use crate::reference::sh;
use crate::render::plane_count;
use crate::scene::sh_coefficient_count;

/// Harmonics, moments and the factors of gradients.
pub struct AdamColorInput {
    /// Parameters and moments; gradients of the harmonics are products of the factors.
    pub adam: AdamInput,
    /// SH degree.
    pub sh_degree: u32,
    /// Gradients in planes: of colours, and directions.
    factors: Vec<[f32; 4]>,
}

impl AdamColorInput {
    /// Random numbers. `poison` is in the colour's gradient of every third splat.
    pub fn new(count: usize, stride: usize, sh_degree: u32, magnitude: f64, poison: Option<f32>) -> AdamColorInput {
        let planes = GEOMETRY_PLANES as usize..plane_count(sh_degree);
        let mut adam = AdamInput::new(count, stride, planes, magnitude);
        let mut factors = vec![[f32::NAN; 4]; GRADIENT_PLANES as usize * stride];
        let random = &mut Random::new(count as u64 + 1);
        for splat in 0..stride {
            let mut d_color = [0; 3].map(|_| random.between(-magnitude, magnitude) as f32);
            if let (Some(poison), 1) = (poison, splat % 3) {
                d_color[splat % 2] = poison;
            }
            let axes = [0; 3].map(|_| random.normal());
            let length = axes.iter().map(|v| v * v).sum::<f64>().sqrt();
            let direction = axes.map(|v| (v / length) as f32);
            let [r, g, b] = d_color;
            let [x, y, z] = direction;
            factors[D_COLOR_PLANE as usize * stride + splat] = [r, g, b, 0.0];
            factors[DIRECTION_PLANE as usize * stride + splat] = [x, y, z, 0.0];
            let basis = sh::basis(sh_degree, direction.map(f64::from));
            for k in 0..4 * (plane_count(sh_degree) - GEOMETRY_PLANES as usize) {
                let is_used = k < 3 * sh_coefficient_count(sh_degree);
                let gradient = if is_used {
                    basis[k / 3] * f64::from(d_color[k % 3])
                } else {
                    0.0
                };
                let plane = GEOMETRY_PLANES as usize + k / 4;
                adam.vectors[1][plane * stride + splat][k % 4] = gradient as f32;
            }
        }
        AdamColorInput {
            adam,
            sh_degree,
            factors,
        }
    }
}

/// One step for `count` splats of degree 3.
pub fn usual<'a>(gpu: &Gpu, count: usize) -> Result<KernelCase<'a, AdamColor>> {
    adam_color(gpu, AdamColorInput::new(count, count, 3, 1.0, None))
}

/// One step.
pub fn adam_color<'a>(gpu: &Gpu, input: AdamColorInput) -> Result<KernelCase<'a, AdamColor>> {
    let d_params = gpu.buffer_from("factors", &input.factors)?;
    let (p, degree) = (input.adam.params(), input.sh_degree);
    let params = Params {
        first_splat: p.first_splat,
        splat_count: p.splat_count,
        stride: p.stride,
        rate_sh_dc: SH_RATES[0],
        rate_sh_rest: SH_RATES[1],
        beta1: p.beta1,
        beta2: p.beta2,
        epsilon: p.epsilon,
        correction1: p.correction1,
        correction2: p.correction2,
    };
    // Eight roundings of a basis function's terms, whose magnitudes add up to 3 at most, are 24u of a gradient; a tenth
    // of that enters the moment, beside 4u of its own.
    let (case, buffers) = stepped(gpu, input.adam, 7.0)?;
    let case = case.commands(move |rec, kernel: &AdamColor, _| {
        let io = Bindings {
            counts: &buffers.counts,
            d_params: &d_params,
            params: &buffers.params,
            moment1: &buffers.moment1,
            moment2: &buffers.moment2,
        };
        kernel.record(rec, io, params, kernel.groups(params.splat_count as usize));
    });
    Ok(case.tune(move |choice: &mut Choice| choice.spec.sh_degree = degree))
}
