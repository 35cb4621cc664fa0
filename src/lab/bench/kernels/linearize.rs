//! Case of `linearize`: a host's depths, in a rectangle of an image of our own.

use super::KernelCase;
use super::present::{ORIGIN, extent_around};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::linearize::{Bindings, Linearize, Params};
use crate::kernels::present;
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::random::Random;
use crate::layout::View;
use crate::reference::linearize::{Code, limit};
use crate::reference::tiles::Grid;

/// Depths reversed and infinite.
pub fn usual<'a>(gpu: &Gpu, size: [u32; 2]) -> Result<KernelCase<'a, Linearize>> {
    let code = Code {
        a: 0.0,
        b: 0.125,
        is_linear: false,
        empty: 0.0,
    };
    linearize(gpu, size, code)
}

/// Random depths, pixels without a surface, and depths behind the camera, of an image of `size` pixels.
pub fn linearize<'a>(gpu: &Gpu, size: [u32; 2], code: Code) -> Result<KernelCase<'a, Linearize>> {
    let [width, height] = size;
    let pixels = (width * height) as usize;
    let random = &mut Random::new(u64::from(width));
    let stored = |i: usize, z: f64| match (i % 7, code.is_linear) {
        (3, _) => code.empty,
        (5, _) => code.a - if code.is_linear { code.b * z } else { code.b / z },
        (_, true) => code.a + code.b * z,
        (_, false) => code.a + code.b / z,
    };
    let depths: Vec<f32> = (0..pixels)
        .map(|i| stored(i, random.log_between(0.1, 1e3)) as f32)
        .collect();
    let expected: Vec<f64> = depths.iter().map(|&d| limit(d.into(), &code)).collect();
    let grid = Grid::new(width, height);
    let mut farthest = vec![0.0f64; grid.len() as usize];
    for (i, &z) in expected.iter().enumerate() {
        let at = [f64::from(i as u32 % width) + 0.5, f64::from(i as u32 / width) + 0.5];
        let tile = &mut farthest[grid.tile_from_position(at) as usize];
        *tile = tile.max(z);
    }
    let view = View {
        size,
        ..View::default()
    };
    let view = gpu.buffer_from("view", &[view])?;
    let planes = gpu.buffer_from("image", &depths.repeat(4))?;
    let stored = gpu.image("stored", extent_around(size))?;
    let write = present::Present::new(gpu, present::Choice::default())?;
    let image = stored.clone();
    let limits = gpu.buffer::<f32>("limit_from_pixel", pixels + 1)?;
    let farthest_found = gpu.buffer::<f32>("limit_from_tile", farthest.len() + 1)?;
    let case = KernelCase::new(Work::of(pixels, "pixels").moving(20 * pixels))
        .before(move |rec, _| {
            rec.clear(&image, f32::NAN);
            let io = present::Bindings {
                view: &view,
                image: &planes,
                target: &image,
            };
            write.record(rec, io, present::Params { origin: ORIGIN }, present::groups(size));
        })
        .compare(&limits, move |found| vec![output("limits", &found, &expected)])
        .compare(&farthest_found, move |found| {
            vec![output("farthest", &found, &farthest)]
        });
    let tiles = grid.len() as usize;
    Ok(case.commands(move |rec, kernel: &Linearize, _| {
        let io = Bindings {
            stored: &stored,
            limit_from_pixel: &limits,
            limit_from_tile: &farthest_found,
        };
        let params = Params {
            a: code.a as f32,
            b: code.b as f32,
            linear: code.is_linear.into(),
            empty: code.empty as f32,
            size,
            origin: ORIGIN,
        };
        kernel.record(rec, io, params, kernel.groups(tiles));
    }))
}

/// Limits beside the expected ones and one element beyond, which must not be written. A difference and a quotient have
/// a rounding of 2⁻²⁴ and of 2.5 ULP: 2.1e-7. Infinity is compared as −1.
fn output(name: &'static str, found: &[f32], expected: &[f64]) -> Output {
    let finite = |z: f64| if z.is_infinite() { -1.0 } else { z };
    let found = floats(found).into_iter().map(finite).collect();
    let mut expected: Vec<f64> = expected.iter().map(|&z| finite(z)).collect();
    expected.push(f64::NAN);
    Output::relative(name, found, expected, 3e-7, 0.0)
}
