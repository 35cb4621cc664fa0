//! Case of `surface_loss`: a wavy surface with steps and holes, its normals and the spreads of its depths.

use super::KernelCase;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::surface_loss::{self, Bindings, Choice, Params, SurfaceLoss};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats, rms};
use crate::lab::bench::input::random::{Random, single};
use crate::lab::bench::input::volume::camera;
use crate::layout::{D_COVERAGE, D_NORMAL, D_SPREAD, D_SPREAD_PLANES, D_SURFACE_PLANES, SPREAD_PLANES};
use crate::reference::linear::{normalize, scale};
use crate::reference::plane::SurfacePixel;
use crate::reference::surface_loss::{SurfaceWeights, pixel_loss};
use crate::reference::{Dual, Real};
use crate::render::{ViewOptions, view_of};
use crate::scene::Camera;
use rayon::prelude::*;

/// Weights of a pixel: those of a frame of a thousand pixels.
const NORMAL: f32 = 5e-5;
const SPREAD: f32 = 1e-3;

/// Surface of a pixel, no number near a threshold.
fn made(random: &mut Random, x: f64, y: f64) -> SurfacePixel {
    let open = random.below(40) == 0;
    let coverage = single(if open {
        random.between(0.1, 0.45)
    } else {
        random.between(0.55, 0.99)
    });
    // Waves of slopes up to two footprints, and a step.
    let wave = 0.05 * (0.21 * x).sin() + 0.04 * (0.17 * y + 0.08 * x).cos();
    let z = 5.0 * (1.0 + 0.1 * wave + if x > 30.0 && y > 10.0 { 0.6 } else { 0.0 });
    let length = if random.below(30) == 0 {
        0.02
    } else {
        random.between(0.4, 0.95)
    };
    let toward = [0.4 * random.normal(), 0.4 * random.normal(), -1.0];
    let normal = scale(coverage * length, normalize(toward)).map(single);
    let log = 0.03 * random.normal();
    SurfacePixel {
        coverage,
        depth: single(coverage * z * (1.0 + 2e-4 * random.normal())),
        median: z,
        interquartile: 0.5 * z,
        normal,
        first: single(z * (1.0 + 0.02 * random.normal())),
        spread: random.log_between(1e-5, 1e-3),
        log,
        margin: 0.0,
    }
}

/// Derivatives of the terms of the consistency by the coverage, the depth and the normal of a pixel: its own term and
/// those of its neighbours.
fn slopes(pixels: &[SurfacePixel], camera: &Camera, pixel: usize) -> [f64; 5] {
    let weights = SurfaceWeights {
        normal: NORMAL.into(),
        spread: 0.0,
    };
    let at = |i: usize| {
        let variable = |value: f64, slot: usize| Dual::<5>::variable(value, (i == pixel).then_some(slot));
        let p = &pixels[i];
        let zero = Dual::of(0.0);
        SurfacePixel {
            coverage: variable(p.coverage, 0),
            depth: variable(p.depth, 1),
            median: zero,
            interquartile: zero,
            normal: [0, 1, 2].map(|k| variable(p.normal[k], 2 + k)),
            first: zero,
            spread: zero,
            log: zero,
            margin: 0.0,
        }
    };
    let (width, count) = (camera.width as usize, pixels.len());
    let (x, y) = (pixel % width, pixel / width);
    let near = [
        Some(pixel),
        (x > 0).then(|| pixel - 1),
        (x + 1 < width).then_some(pixel + 1),
        (y > 0).then(|| pixel - width),
        (pixel + width < count).then_some(pixel + width),
    ];
    let terms = near.into_iter().flatten().map(|i| pixel_loss(at, camera, weights, i));
    terms.sum::<Dual<5>>().d
}

/// The terms on an image of `size` pixels.
///
/// A depth is a quotient of two roundings, 3u of itself with u = 2⁻²⁴, and a vector between neighbours is about two of
/// f footprints: its direction is off by 3u · f = 2e-4 / 1000 · f, 1e-4 at f = 500; derivatives divide by two such
/// lengths.
pub fn surface_loss<'a>(gpu: &Gpu, size: [u32; 2], with_spread: bool) -> Result<KernelCase<'a, SurfaceLoss>> {
    let [width, height] = size;
    let count = (width * height) as usize;
    let camera = camera(size);
    let random = &mut Random::new(u64::from(width) + 17);
    let pixels: Vec<SurfacePixel> = (0..count)
        .map(|i| made(random, (i % width as usize) as f64, (i / width as usize) as f64))
        .collect();
    let options = ViewOptions {
        background: [0.0; 3],
        near: 0.01,
        filter: Default::default(),
    };
    let plane = |of: &dyn Fn(&SurfacePixel) -> f64| -> Vec<f32> { pixels.iter().map(|p| of(p) as f32).collect() };
    let mut image = vec![0.0; 3 * count];
    image.extend(plane(&|p| 1.0 - p.coverage));
    let surface: [Vec<f32>; SPREAD_PLANES as usize] = [
        plane(&|p| p.depth),
        plane(&|p| p.median),
        plane(&|p| p.normal[0]),
        plane(&|p| p.normal[1]),
        plane(&|p| p.normal[2]),
        plane(&|p| p.interquartile),
        plane(&|p| p.first),
        plane(&|p| p.coverage * p.log),
        plane(&|p| p.coverage * (p.spread + p.log * p.log)),
    ];
    let view = gpu.buffer_from("view", &[view_of(&camera, &options)])?;
    let image = gpu.buffer_from("image", &image)?;
    let surface = gpu.buffer_from("surface", &surface.concat())?;
    let planes = if with_spread { D_SPREAD_PLANES } else { D_SURFACE_PLANES };
    let d_image = gpu.buffer::<f32>("d_image", planes as usize * count)?;
    let case = KernelCase::new(Work::of(count, "pixels").moving(4 * count * (10 + planes as usize)))
        .tune(move |choice: &mut Choice| choice.spec.with_spread = with_spread.into())
        .compare(&d_image, move |found| outputs(&pixels, &camera, &found, with_spread));
    Ok(case.commands(move |rec, kernel: &SurfaceLoss, _| {
        let io = Bindings {
            view: &view,
            image: &image,
            surface: &surface,
            d_image: &d_image,
        };
        let params = Params {
            normal_scale: NORMAL,
            spread_scale: SPREAD,
            counted: [0, size[1]],
        };
        kernel.record(rec, io, params, surface_loss::groups(size));
    }))
}

fn outputs(pixels: &[SurfacePixel], camera: &Camera, found: &[f32], with_spread: bool) -> Vec<Output> {
    let count = pixels.len();
    let slopes: Vec<[f64; 5]> = (0..count).into_par_iter().map(|i| slopes(pixels, camera, i)).collect();
    let planes = |first: u32, length: usize| floats(&found[first as usize * count..][..length * count]);
    let expected = |slots: std::ops::Range<usize>| -> Vec<f64> {
        let slot = |slot: usize| slopes.iter().map(move |of| of[slot]);
        slots.flat_map(slot).collect()
    };
    let relative = |name, found, expected: Vec<f64>, tolerance| {
        let scale = rms(&expected).max(1e-12);
        Output::relative(name, found, expected, tolerance, scale)
    };
    // Gradients by colours are not written.
    let d_depth = [vec![f64::NAN; D_COVERAGE as usize * count], expected(0..2)].concat();
    let scale = rms(&expected(0..2)).max(1e-12);
    let mut all = vec![
        Output::relative("d_depth", planes(0, D_COVERAGE as usize + 2), d_depth, 2e-3, scale),
        relative("d_normal", planes(D_NORMAL, 3), expected(2..5), 2e-3),
    ];
    if with_spread {
        let has = |p: &SurfacePixel| p.coverage >= 0.5;
        let of = |of: &dyn Fn(&SurfacePixel) -> f64| -> Vec<f64> { pixels.iter().map(of).collect() };
        let factor = of(&|p| if has(p) { f64::from(SPREAD) } else { 0.0 });
        let center = of(&|p| if has(p) { p.first * p.log.exp() } else { 1.0 });
        let variance = of(&|p| if has(p) { p.spread } else { 0.0 });
        all.push(relative("factor", planes(D_SPREAD, 1), factor, 0.0));
        all.push(relative("center", planes(D_SPREAD + 1, 1), center, 3e-6));
        // A difference of squares up to (4 · 0.03)², in units of 1e-4.
        all.push(relative("variance", planes(D_SPREAD + 2, 1), variance, 2e-4));
    }
    all
}
