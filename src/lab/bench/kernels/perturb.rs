//! Case of `perturb`: exploration noise of the splats' own shape.

use super::{KernelCase, counts, sample};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::perturb::{Bindings, Choice, Params, Perturb};
use crate::lab::bench::Work;
use crate::lab::bench::check::Output;
use crate::lab::bench::input::random::Random;
use crate::lab::bench::input::scene::Scene;
use crate::reference::Splat;
use crate::reference::perturb::{normals, perturb as reference};
use crate::render::planes_from_splats;
use crate::scene::Primitive;

/// Splats that are compared.
const SAMPLES: usize = 3000;

/// Parameters of the noise, for splats that begin a block at number 262,144.
pub const PARAMS: Params = Params {
    first_splat: 262_144,
    splat_count: 0,
    stride: 0,
    seed: 0xdead_beef,
    step: 12_345,
    amplitude: 40.0,
    indexed: 0,
};

/// A scene with opacities around the one at which the noise fades.
pub fn faint(mut scene: Scene) -> Scene {
    let random = &mut Random::new(9);
    for logit in &mut scene.splats.opacity_logit {
        *logit = random.between(-9.0, -3.0) as f32;
    }
    for scale in scene.splats.log_scale.iter_mut().flatten() {
        *scale = random.between(-4.0, -1.0) as f32;
    }
    scene
}

/// Noise on the means of a scene; no other number may change.
pub fn perturb<'a>(gpu: &Gpu, scene: &Scene) -> Result<KernelCase<'a, Perturb>> {
    let (splats, count) = (scene.splats.clone(), scene.splats.len());
    let is_surfel = splats.primitive == Primitive::Surfel;
    let planes = planes_from_splats(&splats);
    let counts = counts(gpu, &[])?;
    let before = gpu.buffer_from("before", &planes)?;
    let values = gpu.buffer::<[f32; 4]>("params", planes.len())?;
    let index = gpu.buffer_from("splat_from_slot", &[u32::MAX])?;
    // Three planes in, one out.
    let work = Work::of(count, "splats").moving(64 * count);
    let case = KernelCase::new(work).tune(move |choice: &mut Choice| choice.spec.surfel = is_surfel.into());
    let case = case.compare(&values, move |after| {
        let [mut found, mut expected] = [(); 2].map(|()| Vec::new());
        for i in sample(planes.len(), SAMPLES * planes.len() / count.max(1)) {
            found.extend(after[i].map(f64::from));
            let mut four = planes[i].map(f64::from);
            if i < count {
                let mut s = Splat::<f64>::of(&splats, i);
                if is_surfel {
                    // Out of the plane by a tenth of the smaller scale.
                    s.log_scale[2] = s.log_scale[0].min(s.log_scale[1]) + 0.1_f64.ln();
                }
                let xi = normals(PARAMS.seed, PARAMS.step, PARAMS.first_splat + i as u32);
                let amplitude = f64::from(PARAMS.amplitude);
                let shape = (s.quaternion, s.log_scale);
                let mean = reference(s.mean, shape.0, shape.1, s.opacity_logit, xi, amplitude);
                four[..3].copy_from_slice(&mean);
            }
            expected.extend(four);
        }
        // Noise is of size one here, of radii up to sqrt(2 ln 2^32) = 6.7. The Vulkan specification grants sine and
        // cosine an absolute error of 2^-11; that of the logarithm, 2^-21 near 1 and 3 ULP elsewhere, is small beside
        // it.
        vec![Output::relative("parameters", found, expected, 6.7 / 2048.0, 1.0)]
    });
    Ok(case.copy(&before, &values).commands(move |rec, kernel: &Perturb, _| {
        let io = Bindings {
            counts: &counts,
            params: &values,
            splat_from_slot: &index,
        };
        let params = Params {
            splat_count: count as u32,
            stride: count as u32,
            ..PARAMS
        };
        kernel.record(rec, io, params, kernel.groups(count));
    }))
}
