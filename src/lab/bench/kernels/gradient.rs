//! Cases of compositing's gradient.

use super::composite::{Composite, CompositeBuffers};
use super::{KernelCase, read};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::kernels::{Kernel, baseline_16x16_backward, rasterize_backward, walker_bindings};
use crate::lab::bench::check::{Output, floats, rms};
use crate::lab::bench::input::pack;
use crate::lab::bench::input::random::Random;
use crate::reference::Thresholds;
use crate::reference::rasterize_backward::{PixelGradient, ScreenGradient, pixel_backward};
use crate::render::tile_stride;
use std::rc::Rc;

/// One pixel in so many has a gradient in checked runs of large inputs, for the reference's sake.
pub const SAMPLED: u64 = 16;

/// The nine sums' names, in the order of `whitened_sums`.
const NAMES: [&str; 9] = ["s", "s x", "s y", "s xx", "s xy", "s yy", "red", "green", "blue"];

/// A gradient of the image, and the sums that should come of it.
pub struct Gradient {
    /// Upstream gradient of every pixel, for timed runs.
    pub d_image: Vec<f32>,
    /// Upstream gradient of a sample of the pixels and zero elsewhere, for checked runs.
    pub d_sampled: Vec<f32>,
    /// Expected sums of the sample, by source.
    sums_from_source: Vec<[f64; 9]>,
    /// The same by splat.
    pub sums_from_splat: Vec<[f64; 9]>,
}

impl Gradient {
    /// A random gradient, of one pixel in `sampled` for checked runs.
    pub fn new(composite: &Composite, sampled: u64) -> Gradient {
        let pixels = composite.pixels.len();
        let random = &mut Random::new(8);
        let d_image: Vec<f32> = (0..3 * pixels).map(|_| random.normal() as f32).collect();
        // A pixel at a discontinuity might go either way: it is given nothing to say.
        let judged: Vec<bool> = (0..pixels)
            .map(|i| {
                let expected = &composite.pixels[i];
                random.bits().is_multiple_of(sampled) && !expected.near && !expected.capped
            })
            .collect();
        let sampled = |(i, &d): (usize, &f32)| if judged[i % pixels] { d } else { 0.0 };
        let d_sampled = d_image.iter().enumerate().map(sampled).collect();
        let sums_from_source = sums(composite, &d_image, &judged);
        let mut sums_from_splat = vec![[0.0; 9]; composite.scene.splats.len()];
        for (isect, sums) in composite.lists.isects.iter().zip(&sums_from_source) {
            let total = &mut sums_from_splat[isect.splat as usize];
            total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
        }
        Gradient {
            d_image,
            d_sampled,
            sums_from_source,
            sums_from_splat,
        }
    }

    /// Sums by splat, nine in a row, held against the oracle's.
    pub fn judge_splats(&self, found: &[f32], tolerance: f64) -> Vec<Output> {
        outputs(&self.sums_from_splat, tolerance, |quantity| {
            let column = found.iter().skip(quantity).step_by(9);
            column.map(|&sum| f64::from(sum)).collect()
        })
    }
}

/// Sums of the gradients of the checked pixels, by source.
fn sums(composite: &Composite, d_image: &[f32], judged: &[bool]) -> Vec<[f64; 9]> {
    let pixels = judged.len();
    let lists = &composite.lists;
    let background = composite.background();
    let upstream = |i: usize| PixelGradient {
        color: [0, 1, 2].map(|channel| f64::from(d_image[channel * pixels + i])),
        ..PixelGradient::default()
    };
    let mut gradients = vec![ScreenGradient::default(); lists.isects.len()];
    composite.fold_sources(
        |i, ranks, at| match judged[i] {
            true => {
                let thresholds = &Thresholds::ENGINE;
                pixel_backward(&composite.splats, ranks, at, background, thresholds, &upstream(i))
            }
            false => Vec::new(),
        },
        |source, _, (_, gradient)| {
            let row = gradients[source].row.iter_mut().zip(gradient.row);
            row.for_each(|(sum, term)| *sum += term);
        },
        |&(rank, _)| rank,
    );
    let whitened = |(isect, gradient): (&crate::reference::expand::Isect, &ScreenGradient)| {
        let screen = lists.screen[isect.splat as usize].as_ref();
        screen.map_or([0.0; 9], |screen| pack::whitened_sums(screen, gradient))
    };
    lists.isects.iter().zip(&gradients).map(whitened).collect()
}

/// Tolerance of sums by source, in units of their typical size.
///
/// Terms of a sum over 128 pixels carry the error of alpha (2e-5, see `Composite::outputs`) and of the transmittance
/// that is regained by one division per splat, 2u each; upstream signs alternate, so sums are smaller than their terms
/// by about sqrt(128), and residuals contribute up to 3.3 squared.
pub const SOURCE_TOLERANCE: f64 = 1e-4;

/// Tolerance of sums by splat, which add up those of several tiles.
pub const SPLAT_TOLERANCE: f64 = 2e-4;

/// Tolerance of both for splats at the cap of alphas: next to it, a float knows an alpha's complement to 4 parts in a
/// thousand.
pub const CAPPED_TOLERANCE: f64 = 6e-3;

/// Nine columns, each in units of its own typical size.
fn outputs(expected: &[[f64; 9]], tolerance: f64, found: impl Fn(usize) -> Vec<f64>) -> Vec<Output> {
    let column = |quantity: usize| {
        let expected: Vec<f64> = expected.iter().map(|sums| sums[quantity]).collect();
        let scale = rms(&expected).max(1e-6);
        Output::relative(NAMES[quantity], found(quantity), expected, tolerance, scale)
    };
    (0..9).map(column).collect()
}

/// Device buffers of the backward kernels.
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
    /// Uploads the gradient and the expected outputs of the forward pass.
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

    /// Bindings of the engine's kernel.
    pub fn rasterize_backward<'a>(&'a self, input: &'a CompositeBuffers) -> rasterize_backward::Bindings<'a> {
        walker_bindings! {
            rasterize_backward, input, &input.emitted_from_isect;
            blue_depth_from_splat: &input.blue_depth_from_splat,
            image: &self.pixels[0],
            d_image: &self.pixels[3],
            isect_end_from_pixel: &self.isect_end_from_pixel,
            d_shape_from_source: &self.d_shape,
            d_tone_from_source: &self.d_tone,
            d_rest_from_source: &self.d_rest,
        }
    }

    /// Bindings of the baseline.
    pub fn baseline_16x16_backward<'a>(&'a self, input: &'a CompositeBuffers) -> baseline_16x16_backward::Bindings<'a> {
        baseline_16x16_backward::Bindings {
            view: &input.view,
            range_from_tile: &input.range_from_tile,
            splat_from_isect: &input.splat_from_isect,
            ellipse_from_splat: &input.ellipse_from_splat,
            whiten_rg_from_splat: &input.whiten_rg_from_splat,
            blue_depth_from_splat: &input.blue_depth_from_splat,
            image: &self.pixels[0],
            d_image: &self.pixels[3],
            isect_end_from_pixel: &self.isect_end_from_pixel,
            sum_from_splat: &self.sum_from_splat,
        }
    }

    /// Outputs of the engine's kernel beside the reference's.
    pub fn judge_sources(&self, gradient: &Gradient, tolerance: f64) -> Result<Vec<Output>> {
        let shape = floats(&read(&self.gpu, &self.d_shape)?);
        let tone = floats(&read(&self.gpu, &self.d_tone)?);
        let rest = floats(&read(&self.gpu, &self.d_rest)?);
        Ok(outputs(&gradient.sums_from_source, tolerance, |quantity| {
            let column = |list: &[f64], at: usize| list.iter().skip(at).step_by(4).copied().collect();
            match quantity {
                0..4 => column(&shape, quantity),
                4..8 => column(&tone, quantity - 4),
                _ => rest.clone(),
            }
        }))
    }

    /// Outputs of the baseline beside the reference's.
    pub fn judge_splats(&self, gradient: &Gradient, tolerance: f64) -> Result<Vec<Output>> {
        Ok(gradient.judge_splats(&read(&self.gpu, &self.sum_from_splat)?, tolerance))
    }
}

/// A step through the tiles, as the engine has it.
pub fn params(input: &CompositeBuffers) -> rasterize_backward::Params {
    rasterize_backward::Params {
        tile_stride: tile_stride(input.tiles),
        band: 0,
    }
}

/// Input, gradient and buffers of a case of either kernel.
type GradientCase = Rc<(CompositeBuffers, Gradient, Device)>;

fn held(gpu: &Gpu, composite: &Composite, sampled: u64) -> Result<GradientCase> {
    let gradient = Gradient::new(composite, sampled);
    let device = Device::new(gpu, composite, &gradient)?;
    Ok(Rc::new((CompositeBuffers::new(gpu, composite)?, gradient, device)))
}

/// Adds the upstream gradients to a case of either kernel, of a sample in checked runs.
fn with_upstream<'a, K: Kernel + 'a>(case: KernelCase<'a, K>, held: &GradientCase) -> KernelCase<'a, K> {
    let (checked, timed) = (held.clone(), held.clone());
    case.before(move |rec, _| checked.2.upstream(rec, true))
        .before_timing(move |rec, _| timed.2.upstream(rec, false))
}

/// The engine's gradients by intersection.
pub fn rasterize_backward<'a>(
    gpu: &Gpu,
    composite: &'a Composite,
    sampled: u64,
    tolerance: f64,
) -> Result<KernelCase<'a, rasterize_backward::RasterizeBackward>> {
    let held = held(gpu, composite, sampled)?;
    let (recorded, found) = (held.clone(), held.clone());
    let case = KernelCase::new(composite.work(), {
        move |rec, kernel: &rasterize_backward::RasterizeBackward, _| {
            let (input, _, device) = &*recorded;
            let io = device.rasterize_backward(input);
            kernel.record(rec, io, params(input), input.groups());
        }
    });
    let case = with_upstream(case, &held);
    let case = case.erase(&held.2.d_shape).erase(&held.2.d_tone).erase(&held.2.d_rest);
    Ok(case.judge(move |_, _| found.2.judge_sources(&found.1, tolerance)))
}

/// The baseline's gradients by splat, of a scene in its square tiles.
pub fn baseline_16x16_backward<'a>(
    gpu: &Gpu,
    composite: &'a Composite,
    sampled: u64,
    tolerance: f64,
) -> Result<KernelCase<'a, baseline_16x16_backward::Baseline16x16Backward>> {
    let held = held(gpu, composite, sampled)?;
    let (recorded, found) = (held.clone(), held.clone());
    let case = KernelCase::new(composite.work(), {
        move |rec, kernel: &baseline_16x16_backward::Baseline16x16Backward, _| {
            let (input, _, device) = &*recorded;
            let io = device.baseline_16x16_backward(input);
            kernel.record_cleared(rec, io, input.groups());
        }
    });
    Ok(with_upstream(case, &held).judge(move |_, _| found.2.judge_splats(&found.1, tolerance)))
}
