//! Case of `overlay`: a composited image over a rectangle of the pixels of a storage image of our own.

use super::KernelCase;
use super::present::{ORIGIN, extent_around, values_around};
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::overlay::{Bindings, Overlay, Params};
use crate::kernels::present;
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::random::Random;
use crate::layout::View;
use crate::reference::overlay::{over_display, over_linear};

/// Random planes of splats and of a host's pixels, and the expected pixels.
struct Pixels {
    above: Vec<f32>,
    below: Vec<f32>,
    expected: Vec<[f64; 4]>,
    /// The host's pixels where there are no splats, else NaN.
    kept: Vec<[f64; 4]>,
}

/// Colours and transmittances, 1 and 0 among them.
fn random_pixels(pixels: usize, gain: Option<f32>) -> Pixels {
    let random = &mut Random::new(pixels as u64);
    let mut above = vec![0.0f32; 4 * pixels];
    let mut below = vec![0.0f32; 4 * pixels];
    let (mut expected, mut kept) = (Vec::new(), Vec::new());
    for i in 0..pixels {
        let transmittance = match i % 5 {
            1 => 1.0,
            3 => 0.0,
            _ => random.between(0.0, 1.0) as f32,
        };
        for plane in 0..3 {
            above[plane * pixels + i] = (1.0 - transmittance) * random.between(0.0, 1.5) as f32;
            below[plane * pixels + i] = random.between(0.0, 2.0) as f32;
        }
        above[3 * pixels + i] = transmittance;
        below[3 * pixels + i] = random.between(0.0, 1.0) as f32;
        let [red, green, blue, transmittance] = std::array::from_fn(|plane| f64::from(above[plane * pixels + i]));
        let [r, g, b, through] = std::array::from_fn(|plane| f64::from(below[plane * pixels + i]));
        // `present` writes opacities.
        let under = [r, g, b, f64::from(1.0 - through as f32)];
        expected.push(match gain {
            None => over_display([red, green, blue], transmittance, under),
            Some(gain) => over_linear([red, green, blue], transmittance, under, gain.into()),
        });
        kept.push(if transmittance == 1.0 { under } else { [f64::NAN; 4] });
    }
    Pixels {
        above,
        below,
        expected,
        kept,
    }
}

/// A composited image over the pixels of an image of `size` pixels; linear light with a gain.
pub fn overlay<'a>(gpu: &Gpu, size: [u32; 2], gain: Option<f32>) -> Result<KernelCase<'a, Overlay>> {
    let pixels = (size[0] * size[1]) as usize;
    let Pixels {
        above,
        below,
        expected,
        kept,
    } = random_pixels(pixels, gain);
    let view = View {
        size,
        ..View::default()
    };
    let view = gpu.buffer_from("view", &[view])?;
    let image = gpu.buffer_from("image", &above)?;
    let host = gpu.buffer_from("below", &below)?;
    let target = gpu.image("target", extent_around(size))?;
    let [expected, kept] = [expected, kept].map(|pixels| values_around(size, |i| pixels[i]));
    let write = present::Present::new(gpu, present::Choice::default())?;
    let (first, found, seen) = (target.clone(), target.clone(), view.clone());
    let work = Work::of(pixels, "pixels").moving(48 * pixels);
    let case = KernelCase::new(work)
        .before(move |rec, _| {
            rec.clear(&first, f32::NAN);
            let io = present::Bindings {
                view: &seen,
                image: &host,
                target: &first,
            };
            write.record(rec, io, present::Params { origin: ORIGIN }, present::groups(size));
        })
        .judge(move |gpu| {
            let found = floats(&gpu.download_image(&found)?);
            let or_nan = |(found, kept): (&f64, &f64)| if kept.is_nan() { f64::NAN } else { *found };
            let under = found.iter().zip(&kept).map(or_nan).collect();
            // Powers have 16 ULP of exp2 and log2 each, of light up to 2.4 times the gain of 2.
            let pixels = Output::relative("pixels", found, expected.clone(), 1e-5, 1.0);
            Ok(vec![
                pixels,
                Output::exact("pixels without splats", under, kept.clone()),
            ])
        });
    Ok(case.commands(move |rec, kernel: &Overlay, _| {
        let io = Bindings {
            view: &view,
            image: &image,
            below: &target,
            target: &target,
        };
        let params = Params {
            linear: gain.is_some().into(),
            gain: gain.unwrap_or(1.0),
            origin: ORIGIN,
        };
        kernel.record(rec, io, params, present::groups(size));
    }))
}
