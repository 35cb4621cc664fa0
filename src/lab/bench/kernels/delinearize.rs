//! Case of `delinearize`: splats of pixels, with surfaces of a host before some of them.

use super::KernelCase;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::delinearize::{Bindings, Delinearize, Params};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::random::Random;
use crate::layout::NO_SPLAT;
use crate::reference::delinearize::{mean_depth, stored};
use crate::reference::linearize::Code;

/// Splats of the case.
const SPLATS: usize = 1000;

/// Depths reversed and infinite, without surfaces.
pub fn usual<'a>(gpu: &Gpu, size: [u32; 2]) -> Result<KernelCase<'a, Delinearize>> {
    let code = Code {
        a: 0.0,
        b: 0.125,
        is_linear: false,
        empty: 0.0,
    };
    delinearize(gpu, (size[0] * size[1]) as usize, code, [false; 2])
}

/// Random splats and depths of pixels.
struct PixelDepths {
    /// Depths of the splats.
    depths: Vec<f32>,
    ids: Vec<u32>,
    /// Depths of the host's surfaces, or none.
    limits: Vec<f32>,
    /// Planes of a picture, of which transmittances count.
    image: Vec<f32>,
    /// Sums of weight times depth.
    sums: Vec<f32>,
}

impl PixelDepths {
    fn new(pixels: usize) -> PixelDepths {
        let random = &mut Random::new(pixels as u64);
        let image = (0..4 * pixels).map(|_| random.between(0.0, 1.0) as f32).collect();
        let mut depth = |_| random.log_between(0.1, 1e3) as f32;
        let mut limits: Vec<f32> = (0..pixels).map(&mut depth).collect();
        limits.iter_mut().step_by(3).for_each(|limit| *limit = f32::INFINITY);
        let id = |i: usize| match i % 4 {
            1 => NO_SPLAT,
            _ => (i * 7919 % SPLATS) as u32,
        };
        PixelDepths {
            depths: (0..SPLATS).map(&mut depth).collect(),
            ids: (0..pixels).map(id).collect(),
            limits,
            image,
            sums: (0..pixels).map(&mut depth).collect(),
        }
    }

    /// Depths of the splats, infinite without one.
    fn of_splats(&self) -> Vec<f64> {
        let depth = |&id: &u32| self.depths.get(id as usize).map_or(f64::INFINITY, |&z| z.into());
        self.ids.iter().map(depth).collect()
    }

    /// Means by weight, infinite below half coverage.
    fn means(&self) -> Vec<f64> {
        let pixels = self.sums.iter().zip(&self.image[3 * self.sums.len()..]);
        pixels.map(|(&sum, &t)| mean_depth(sum.into(), t.into())).collect()
    }
}

/// Random splats, pixels without one, and surfaces at random depths or none, if `limited`; stored are random means if
/// `mean`.
pub fn delinearize<'a>(
    gpu: &Gpu,
    pixels: usize,
    code: Code,
    [limited, mean]: [bool; 2],
) -> Result<KernelCase<'a, Delinearize>> {
    let inputs = PixelDepths::new(pixels);
    let z = inputs.of_splats();
    let of = |(z, limit): (&f64, &f32)| {
        let limit = if limited { f64::from(*limit) } else { f64::INFINITY };
        // Rounding is that of the two terms.
        (
            stored(*z, limit, &code),
            stored(*z, limit, &Code { a: 0.0, ..code }).abs(),
        )
    };
    let written = if mean { inputs.means() } else { z.clone() };
    let expected: Vec<(f64, f64)> = written.iter().zip(&inputs.limits).map(of).collect();
    let rests: Vec<[f32; 2]> = inputs.depths.iter().map(|&z| [f32::NAN, z]).collect();
    let ids = gpu.buffer_from("id_from_pixel", &inputs.ids)?;
    let rests = gpu.buffer_from("blue_depth_from_splat", &rests)?;
    let limits = gpu.buffer_from("limit_from_pixel", &inputs.limits)?;
    let sums = gpu.buffer_from("sum_from_pixel", &inputs.sums)?;
    let image = gpu.buffer_from("image", &inputs.image)?;
    let found_depths = gpu.buffer::<f32>("depth_from_pixel", pixels + 1)?;
    let found_stored = gpu.buffer::<f32>("stored_from_pixel", pixels + 1)?;
    let case = KernelCase::new(Work::of(pixels, "pixels").moving(20 * pixels))
        .compare(&found_depths, move |found| {
            let finite = |z: f64| if z.is_infinite() { -1.0 } else { z };
            let mut expected: Vec<f64> = z.iter().map(|&z| finite(z)).collect();
            // One element beyond, which must not be written.
            expected.push(f64::NAN);
            vec![Output::exact(
                "depths",
                floats(&found).into_iter().map(finite).collect(),
                expected,
            )]
        })
        .compare(&found_stored, move |found| {
            let scale = code.a.abs() + expected.iter().map(|(_, term)| *term).fold(0.0, f64::max);
            let mut wanted: Vec<f64> = expected.iter().map(|(value, _)| *value).collect();
            wanted.push(f64::NAN);
            // A quotient or product of 2.5 ULP and a sum of half of one, of numbers up to `scale`: 3 · 2⁻²³. The mean
            // has a difference and a quotient more.
            let bound = if mean { 7.2e-7 } else { 3.6e-7 };
            vec![Output::relative("stored", floats(&found), wanted, bound, scale)]
        });
    Ok(case.commands(move |rec, kernel: &Delinearize, _| {
        let io = Bindings {
            id_from_pixel: &ids,
            blue_depth_from_splat: &rests,
            limit_from_pixel: &limits,
            depth_from_pixel: &found_depths,
            stored_from_pixel: &found_stored,
            sum_from_pixel: &sums,
            image: &image,
        };
        let params = Params {
            a: code.a as f32,
            b: code.b as f32,
            linear: code.is_linear.into(),
            empty: code.empty as f32,
            limited: limited.into(),
            mean: mean.into(),
            pixels: pixels as u32,
        };
        kernel.record(rec, io, params, kernel.groups(pixels));
    }))
}
