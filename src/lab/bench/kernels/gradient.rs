//! Cases of compositing's gradient.

use super::KernelCase;
use super::composite::{Composite, CompositeBuffers};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::kernels::rasterize::SurfelMode;
use crate::kernels::{Kernel, baseline_16x16_backward, rasterize_backward, walker_bindings};
use crate::lab::bench::check::{Output, rms};
use crate::lab::bench::input::pack;
use crate::lab::bench::input::random::Random;
use crate::layout::{REST_SPOT, REST_TILT};
use crate::reference::Thresholds;
use crate::reference::rasterize::raw_alpha;
use crate::reference::rasterize_backward::{LayerSlopes, PixelGradient, ScreenGradient, layer_slopes, pixel_backward};
use crate::render::tile_stride;
use std::ops::Range;
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
        Gradient::by(composite, sampled, sums)
    }

    /// The same for surfels: of each record's sums only s and those of the colours are expected.
    pub fn of_surfels(composite: &Composite, sampled: u64) -> Gradient {
        Gradient::by(composite, sampled, surfel_sums)
    }

    /// A gradient with its sums by source, of the checked pixels.
    fn by<F>(composite: &Composite, sampled: u64, sums: F) -> Gradient
    where
        F: Fn(&Composite, &[f32], &[bool]) -> Vec<[f64; 9]>,
    {
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
        columns(&self.sums_from_splat, 0..9, found, tolerance)
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
        |source, _, gradient| {
            let row = gradients[source].row.iter_mut().zip(gradient.row);
            row.for_each(|(sum, term)| *sum += term);
        },
    );
    let whitened = |(isect, gradient): (&crate::reference::expand::Isect, &ScreenGradient)| {
        let screen = lists.screen[isect.splat as usize].as_ref();
        screen.map_or([0.0; 9], |screen| pack::whitened_sums(screen, gradient))
    };
    lists.isects.iter().zip(&gradients).map(whitened).collect()
}

/// Sums by source of surfels: s, and those of red, green and blue.
fn surfel_sums(composite: &Composite, d_image: &[f32], judged: &[bool]) -> Vec<[f64; 9]> {
    let pixels = judged.len();
    let (thresholds, background) = (&Thresholds::ENGINE, composite.background());
    let terms = |i: usize, ranks: &[usize], at: [f64; 2]| {
        let upstream = PixelGradient {
            color: [0, 1, 2].map(|channel| f64::from(d_image[channel * pixels + i])),
            ..PixelGradient::default()
        };
        let found = match judged[i] {
            true => layer_slopes(&composite.splats, ranks, at, background, thresholds, &upstream),
            false => Vec::new(),
        };
        let term = |layer: LayerSlopes| {
            let alpha = raw_alpha(&composite.splats[layer.index], at);
            let [by_alpha, red, green, blue, _] = layer.slopes;
            let s = if alpha < thresholds.alpha_max {
                alpha * by_alpha
            } else {
                0.0
            };
            (layer.index, [s, red, green, blue])
        };
        found.into_iter().map(term).collect()
    };
    let mut sums = vec![[0.0; 9]; composite.lists.isects.len()];
    composite.fold_sources(terms, |source, _, &[s, red, green, blue]| {
        let places = [0, 6, 7, 8].into_iter().zip([s, red, green, blue]);
        places.for_each(|(place, term)| sums[source][place] += term);
    });
    sums
}

/// Tolerance of sums by source, in units of their typical size.
///
/// Terms of a sum over 128 pixels carry the error of alpha (2e-5, see `Composite::outputs`) and of the transmittance
/// that is regained by one division per splat, 2u each; upstream signs alternate, so sums are smaller than their terms
/// by about sqrt(128), and residuals contribute up to 3.3 squared.
pub const SOURCE_TOLERANCE: f64 = 1e-4;

/// Tolerance of sums of surfels: the rounding of their alphas counts over the cosine of normal and line of sight, down
/// to 0.3.
pub const SURFEL_TOLERANCE: f64 = 4e-4;

/// Tolerance of sums by splat, which add up those of several tiles.
pub const SPLAT_TOLERANCE: f64 = 2e-4;

/// Tolerance of both for splats at the cap of alphas: next to it, a float knows an alpha's complement to 4 parts in a
/// thousand.
pub const CAPPED_TOLERANCE: f64 = 6e-3;

/// Columns of some of the nine sums, each in units of its own typical size; `found` has these sums in a row.
fn columns(expected: &[[f64; 9]], quantities: Range<usize>, found: &[f32], tolerance: f64) -> Vec<Output> {
    let (first, count) = (quantities.start, quantities.len());
    let column = |quantity: usize| {
        let found = found.iter().skip(quantity - first).step_by(count);
        let expected: Vec<f64> = expected.iter().map(|sums| sums[quantity]).collect();
        let scale = rms(&expected).max(1e-6);
        let found = found.map(|&sum| f64::from(sum)).collect();
        Output::relative(NAMES[quantity], found, expected, tolerance, scale)
    };
    quantities.map(column).collect()
}

/// Inputs of both kernels that the composite's buffers lack.
struct Upstream {
    image: Buffer<f32>,
    isect_end_from_pixel: Buffer<u32>,
    d_image: Buffer<f32>,
}

/// A case of either kernel with the gradient of a sample in checked runs, after the reference's forward pass.
fn with_upstream<'a, K: Kernel + 'a>(
    gpu: &Gpu,
    composite: &Composite,
    gradient: &Gradient,
) -> Result<(KernelCase<'a, K>, Upstream)> {
    let planes: Vec<f32> = composite.planes().iter().map(|&x| x as f32).collect();
    let ends: Vec<u32> = composite.pixels.iter().map(|pixel| pixel.end).collect();
    let whole = gpu.buffer_from("d_image", &gradient.d_image)?;
    let sampled = gpu.buffer_from("d_sampled", &gradient.d_sampled)?;
    let upstream = Upstream {
        image: gpu.buffer_from("image", &planes)?,
        isect_end_from_pixel: gpu.buffer_from("ends", &ends)?,
        d_image: gpu.buffer("d_current", whole.len())?,
    };
    let timed = upstream.d_image.clone();
    let case = KernelCase::new(composite.work())
        .copy(&sampled, &upstream.d_image)
        .before_timing(move |rec, _| rec.copy(&whole, 0..whole.len(), &timed, 0));
    Ok((case, upstream))
}

/// The engine's gradients by intersection.
pub fn rasterize_backward<'a>(
    gpu: &Gpu,
    composite: &Composite,
    gradient: impl Into<Rc<Gradient>>,
    tolerance: f64,
) -> Result<KernelCase<'a, rasterize_backward::RasterizeBackward>> {
    let gradient = gradient.into();
    let (case, upstream) = with_upstream(gpu, composite, &gradient)?;
    let (input, isects) = (CompositeBuffers::new(gpu, composite)?, composite.lists.isects.len());
    let shape = gpu.buffer::<[f32; 4]>("d_shape", isects)?;
    let tone = gpu.buffer::<[f32; 4]>("d_tone", isects)?;
    let rest = gpu.buffer::<f32>("d_rest", isects)?;
    let judge = move |quantities, found: &[f32]| columns(&gradient.sums_from_source, quantities, found, tolerance);
    let (judge_tone, judge_rest) = (judge.clone(), judge.clone());
    let case = case
        .compare(&shape, move |found| judge(0..4, found.as_flattened()))
        .compare(&tone, move |found| judge_tone(4..8, found.as_flattened()))
        .compare(&rest, move |found| judge_rest(8..9, &found));
    Ok(
        case.commands(move |rec, kernel: &rasterize_backward::RasterizeBackward, _| {
            record(rec, kernel, &input, &upstream, [&shape, &tone], &rest);
        }),
    )
}

/// The engine's gradients of surfels by intersection: s and the colours of each record.
pub fn surfels_backward<'a>(
    gpu: &Gpu,
    composite: &Composite,
    gradient: impl Into<Rc<Gradient>>,
    mode: SurfelMode,
    tolerance: f64,
) -> Result<KernelCase<'a, rasterize_backward::RasterizeBackward>> {
    let gradient = gradient.into();
    let (case, upstream) = with_upstream(gpu, composite, &gradient)?;
    let (input, isects) = (CompositeBuffers::new(gpu, composite)?, composite.lists.isects.len());
    let shape = gpu.buffer::<[f32; 4]>("d_shape", isects)?;
    let tone = gpu.buffer::<[f32; 4]>("d_tone", isects)?;
    let spot = if mode == SurfelMode::Any { REST_SPOT } else { 0 };
    let width = 1 + (REST_TILT + spot) as usize;
    let rest = gpu.buffer::<f32>("d_rest", width * isects)?;
    let judge = move |quantities, found: &[f32]| columns(&gradient.sums_from_source, quantities, found, tolerance);
    let (judge_tone, judge_rest) = (judge.clone(), judge.clone());
    let case = case
        .without("blocks")
        .tune(move |choice: &mut rasterize_backward::Choice| choice.spec.surfel = mode.into())
        .compare(&shape, move |found| {
            judge(0..1, &found.iter().map(|row| row[0]).collect::<Vec<_>>())
        })
        .compare(&tone, move |found| {
            judge_tone(6..8, &found.iter().flat_map(|row| [row[2], row[3]]).collect::<Vec<_>>())
        })
        .compare(&rest, move |found| {
            judge_rest(8..9, &found.into_iter().step_by(width).collect::<Vec<_>>())
        });
    Ok(
        case.commands(move |rec, kernel: &rasterize_backward::RasterizeBackward, _| {
            record(rec, kernel, &input, &upstream, [&shape, &tone], &rest);
        }),
    )
}

/// Commands of the engine's kernel.
fn record(
    rec: &mut Recorder<'_>,
    kernel: &rasterize_backward::RasterizeBackward,
    input: &CompositeBuffers,
    upstream: &Upstream,
    [shape, tone]: [&Buffer<[f32; 4]>; 2],
    rest: &Buffer<f32>,
) {
    let io = walker_bindings! {
        rasterize_backward, input, &input.emitted_from_isect;
        blue_depth_from_splat: &input.blue_depth_from_splat,
        image: &upstream.image,
        d_image: &upstream.d_image,
        isect_end_from_pixel: &upstream.isect_end_from_pixel,
        d_shape_from_source: shape,
        d_tone_from_source: tone,
        d_rest_from_source: rest,
        plane_from_splat: &input.plane_from_splat,
    };
    let params = rasterize_backward::Params {
        tile_stride: tile_stride(input.tiles),
        band: 0,
    };
    kernel.record(rec, io, params, input.groups());
}

/// The baseline's gradients by splat, of a scene in its square tiles.
pub fn baseline_16x16_backward<'a>(
    gpu: &Gpu,
    composite: &Composite,
    gradient: impl Into<Rc<Gradient>>,
    tolerance: f64,
) -> Result<KernelCase<'a, baseline_16x16_backward::Baseline16x16Backward>> {
    let gradient = gradient.into();
    let (case, upstream) = with_upstream(gpu, composite, &gradient)?;
    let input = CompositeBuffers::new(gpu, composite)?;
    let sums = gpu.buffer::<f32>("sums", 9 * composite.scene.splats.len())?;
    let case = case.compare(&sums, move |found| gradient.judge_splats(&found, tolerance));
    Ok(
        case.commands(move |rec, kernel: &baseline_16x16_backward::Baseline16x16Backward, _| {
            let io = baseline_16x16_backward::Bindings {
                view: &input.view,
                range_from_tile: &input.range_from_tile,
                splat_from_isect: &input.splat_from_isect,
                ellipse_from_splat: &input.ellipse_from_splat,
                whiten_rg_from_splat: &input.whiten_rg_from_splat,
                blue_depth_from_splat: &input.blue_depth_from_splat,
                image: &upstream.image,
                d_image: &upstream.d_image,
                isect_end_from_pixel: &upstream.isect_end_from_pixel,
                sum_from_splat: &sums,
            };
            kernel.record_cleared(rec, io, input.groups());
        }),
    )
}
