//! The gradient of compositing.

use super::composite::{Composite, INPUTS, Input, LANES};
use super::{read, wanted};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::kernels::{baseline_16x16_backward, rasterize_backward};
use crate::lab::bench::Bench;
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats, rms};
use crate::lab::bench::input::pack;
use crate::lab::bench::input::random::Random;
use crate::reference::Thresholds;
use crate::reference::rasterize_backward::{PixelGradient, ScreenGradient, pixel_backward};
use crate::render::tile_stride;
use rayon::prelude::*;

/// One pixel of so many is given a gradient while results are judged: the oracle takes its time.
const SAMPLED: u64 = 16;

/// The nine sums' names, in the order of `whitened_sums`.
const NAMES: [&str; 9] = [
    "s", "s x", "s y", "s xx", "s xy", "s yy", "red", "green", "blue",
];

/// A gradient of the image, and the sums that should come of it.
pub struct Gradient {
    /// By every pixel: what is timed.
    pub d_image: Vec<f32>,
    /// By a sample of the pixels and zero elsewhere: what is judged.
    pub d_sampled: Vec<f32>,
    /// What the sample should come to, by source.
    sums_from_source: Vec<[f64; 9]>,
    /// The same by splat.
    pub sums_from_splat: Vec<[f64; 9]>,
}

impl Gradient {
    /// A random gradient of a composite.
    pub fn new(composite: &Composite) -> Gradient {
        let pixels = composite.pixels.len();
        let random = &mut Random::new(8);
        let d_image: Vec<f32> = (0..3 * pixels).map(|_| random.normal() as f32).collect();
        // A pixel at a discontinuity might go either way: it is given nothing to say.
        let judged: Vec<bool> = (0..pixels)
            .map(|i| {
                let expected = &composite.pixels[i];
                random.bits().is_multiple_of(SAMPLED) && !expected.near && !expected.capped
            })
            .collect();
        let sampled = |(i, &d): (usize, &f32)| if judged[i % pixels] { d } else { 0.0 };
        let d_sampled = d_image.iter().enumerate().map(sampled).collect();
        let sums_from_source = sums(composite, &d_image, &judged);
        let mut sums_from_splat = vec![[0.0; 9]; composite.scene.splats.len()];
        for (isect, sums) in composite.lists.isects.iter().zip(&sums_from_source) {
            let total = &mut sums_from_splat[isect.splat as usize];
            total
                .iter_mut()
                .zip(sums)
                .for_each(|(total, sum)| *total += sum);
        }
        Gradient {
            d_image,
            d_sampled,
            sums_from_source,
            sums_from_splat,
        }
    }

    /// Sums by splat, nine in a row, held against the oracle's.
    pub fn judge_splats(&self, found: &[f32]) -> Vec<Output> {
        outputs(&self.sums_from_splat, |quantity| {
            let column = found.iter().skip(quantity).step_by(9);
            column.map(|&sum| f64::from(sum)).collect()
        })
    }
}

/// What the judged pixels say, by source.
fn sums(composite: &Composite, d_image: &[f32], judged: &[bool]) -> Vec<[f64; 9]> {
    let pixels = judged.len();
    let lists = &composite.lists;
    let said: Vec<Vec<(usize, ScreenGradient)>> = (0..pixels)
        .into_par_iter()
        .map(|i| {
            if !judged[i] {
                return Vec::new();
            }
            let upstream = PixelGradient {
                color: [0, 1, 2].map(|channel| f64::from(d_image[channel * pixels + i])),
                ..PixelGradient::default()
            };
            let (tile, at) = composite.place(i);
            let ranks = &composite.ranks_from_tile[tile];
            let background = composite.background();
            let splats = &composite.splats;
            let said = pixel_backward(
                splats,
                ranks,
                at,
                background,
                &Thresholds::ENGINE,
                &upstream,
            );
            let begin = lists.range_from_tile[tile][0] as usize;
            let sourced = |(rank, gradient)| {
                let place = ranks.partition_point(|&r| r < rank);
                (lists.emitted_from_isect[begin + place] as usize, gradient)
            };
            said.into_iter().map(sourced).collect()
        })
        .collect();
    let mut gradients = vec![ScreenGradient::default(); lists.isects.len()];
    for (source, gradient) in said.iter().flatten() {
        let row = gradients[*source].row.iter_mut().zip(gradient.row);
        row.for_each(|(sum, term)| *sum += term);
    }
    let whitened = |(isect, gradient): (&crate::reference::expand::Isect, &ScreenGradient)| {
        let screen = lists.screen[isect.splat as usize].as_ref();
        screen.map_or([0.0; 9], |screen| pack::whitened_sums(screen, gradient))
    };
    lists.isects.iter().zip(&gradients).map(whitened).collect()
}

/// Nine columns, each in units of its own typical size; the tolerance is that of the kernels' tests, for sums
/// over a whole splat.
fn outputs(expected: &[[f64; 9]], found: impl Fn(usize) -> Vec<f64>) -> Vec<Output> {
    let column = |quantity: usize| {
        let expected: Vec<f64> = expected.iter().map(|sums| sums[quantity]).collect();
        let scale = rms(&expected).max(1e-6);
        Output::relative(NAMES[quantity], found(quantity), expected, 2e-4, scale)
    };
    (0..9).map(column).collect()
}

/// What the backward kernels read and write, on the device.
pub struct Device {
    gpu: Gpu,
    pixels: [Buffer<f32>; 4],
    isect_end_from_pixel: Buffer<u32>,
    d_shape: Buffer<[f32; 4]>,
    d_tone: Buffer<[f32; 4]>,
    d_rest: Buffer<f32>,
    sum_from_splat: Buffer<f32>,
}

impl Device {
    /// Uploads the gradient, and what the forward pass should have left.
    pub fn new(gpu: &Gpu, composite: &Composite, gradient: &Gradient) -> Result<Device> {
        let planes: Vec<f32> = composite.planes().iter().map(|&x| x as f32).collect();
        let ends: Vec<u32> = composite.pixels.iter().map(|pixel| pixel.end).collect();
        let isects = composite.lists.isects.len();
        Ok(Device {
            gpu: gpu.clone(),
            pixels: [
                gpu.buffer_from("image", &planes)?,
                gpu.buffer_from("d_image", &gradient.d_image)?,
                gpu.buffer_from("d_sampled", &gradient.d_sampled)?,
                gpu.buffer("d_current", gradient.d_image.len())?,
            ],
            isect_end_from_pixel: gpu.buffer_from("ends", &ends)?,
            d_shape: gpu.buffer("d_shape", isects)?,
            d_tone: gpu.buffer("d_tone", isects)?,
            d_rest: gpu.buffer("d_rest", isects)?,
            sum_from_splat: gpu.buffer("sums", 9 * composite.scene.splats.len())?,
        })
    }

    /// Takes the gradient that is judged, or else the whole one.
    pub fn upstream(&self, rec: &mut Recorder<'_>, judged: bool) {
        let from = &self.pixels[if judged { 2 } else { 1 }];
        rec.copy(from, 0..from.len(), &self.pixels[3], 0);
    }

    /// What the engine's kernel binds.
    pub fn rasterize_backward<'a>(&'a self, input: &'a Input) -> rasterize_backward::Bindings<'a> {
        rasterize_backward::Bindings {
            view: &input.view,
            range_from_tile: &input.range_from_tile,
            emitted_from_isect: &input.emitted_from_isect,
            splat_from_emitted: &input.splat_from_emitted,
            ellipse_from_splat: &input.records.shape,
            whiten_rg_from_splat: &input.records.tone,
            blue_depth_from_splat: &input.records.rest,
            image: &self.pixels[0],
            d_image: &self.pixels[3],
            isect_end_from_pixel: &self.isect_end_from_pixel,
            d_shape_from_source: &self.d_shape,
            d_tone_from_source: &self.d_tone,
            d_rest_from_source: &self.d_rest,
        }
    }

    /// What the baseline binds.
    pub fn baseline_16x16_backward<'a>(
        &'a self,
        input: &'a Input,
    ) -> baseline_16x16_backward::Bindings<'a> {
        baseline_16x16_backward::Bindings {
            view: &input.view,
            range_from_tile: &input.range_from_tile,
            splat_from_isect: &input.splat_from_isect,
            ellipse_from_splat: &input.records.shape,
            whiten_rg_from_splat: &input.records.tone,
            blue_depth_from_splat: &input.records.rest,
            image: &self.pixels[0],
            d_image: &self.pixels[3],
            isect_end_from_pixel: &self.isect_end_from_pixel,
            sum_from_splat: &self.sum_from_splat,
        }
    }

    /// What the engine's kernel left.
    pub fn judge_sources(&self, gradient: &Gradient) -> Result<Vec<Output>> {
        let shape = floats(&read(&self.gpu, &self.d_shape)?);
        let tone = floats(&read(&self.gpu, &self.d_tone)?);
        let rest = floats(&read(&self.gpu, &self.d_rest)?);
        Ok(outputs(&gradient.sums_from_source, |quantity| {
            let column =
                |list: &[f64], at: usize| list.iter().skip(at).step_by(4).copied().collect();
            match quantity {
                0..4 => column(&shape, quantity),
                4..8 => column(&tone, quantity - 4),
                _ => rest.clone(),
            }
        }))
    }

    /// What the baseline left.
    pub fn judge_splats(&self, gradient: &Gradient) -> Result<Vec<Output>> {
        Ok(gradient.judge_splats(&read(&self.gpu, &self.sum_from_splat)?))
    }
}

/// A step through the tiles, as the engine has it.
pub fn params(input: &Input) -> rasterize_backward::Params {
    rasterize_backward::Params {
        tile_stride: tile_stride(input.tiles),
        band: 0,
    }
}

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for (name, count, size, sigma) in INPUTS {
        if !wanted!(bench, rasterize_backward, name, LANES, Work::default()).is_empty() {
            engine(bench, name, &Composite::new(count, size, sigma))?;
        }
        if !wanted!(bench, baseline_16x16_backward, name, [0], Work::default()).is_empty() {
            baseline(bench, name, &Composite::baseline_16x16(count, size, sigma))?;
        }
    }
    Ok(())
}

fn engine(bench: &mut Bench, name: &str, composite: &Composite) -> Result<()> {
    let gpu = bench.gpu().clone();
    let input = Input::new(&gpu, composite)?;
    let gradient = Gradient::new(composite);
    let device = Device::new(&gpu, composite, &gradient)?;
    for (variant, workgroup, case) in
        wanted!(bench, rasterize_backward, name, LANES, composite.work())
    {
        if !gpu.caps().lanes_fit(variant.info(), workgroup) {
            continue;
        }
        let spec = rasterize_backward::Spec {
            workgroup,
            ..rasterize_backward::Spec::default()
        };
        let choice = rasterize_backward::Choice { variant, spec };
        let kernel = rasterize_backward::RasterizeBackward::new(&gpu, choice)?;
        let record = |rec: &mut Recorder<'_>| {
            kernel.record(
                rec,
                device.rasterize_backward(&input),
                params(&input),
                input.groups(),
            );
        };
        gpu.run(|rec| device.upstream(rec, true))?;
        gpu.run(record)?;
        case.judge(&device.judge_sources(&gradient)?)?;
        gpu.run(|rec| device.upstream(rec, false))?;
        bench.measure_commands(&case, super::nothing, record)?;
    }
    Ok(())
}

fn baseline(bench: &mut Bench, name: &str, composite: &Composite) -> Result<()> {
    let gpu = bench.gpu().clone();
    let input = Input::new(&gpu, composite)?;
    let gradient = Gradient::new(composite);
    let device = Device::new(&gpu, composite, &gradient)?;
    for (variant, _, case) in wanted!(bench, baseline_16x16_backward, name, [0], composite.work()) {
        let choice = baseline_16x16_backward::Choice {
            variant,
            ..baseline_16x16_backward::Choice::default()
        };
        let kernel = baseline_16x16_backward::Baseline16x16Backward::new(&gpu, choice)?;
        let record = |rec: &mut Recorder<'_>| {
            let io = device.baseline_16x16_backward(&input);
            kernel.record_cleared(rec, io, input.groups());
        };
        gpu.run(|rec| device.upstream(rec, true))?;
        gpu.run(record)?;
        case.judge(&device.judge_splats(&gradient)?)?;
        gpu.run(|rec| device.upstream(rec, false))?;
        bench.measure_commands(&case, super::nothing, record)?;
    }
    Ok(())
}
