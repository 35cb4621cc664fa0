//! The loss, its parts and its gradient.

use super::{nothing, read, sample, wanted};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::{loss, loss_backward, loss_sum};
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::{Bench, Unit, Work};
use crate::layout::{LOSS_TILE_HEIGHT, LOSS_TILE_WIDTH, View};
use crate::reference::ssim::{C1, C2};

/// Pixels of the images.
const SIZES: [[u32; 2]; 2] = [[480, 272], [1920, 1080]];
/// Invocations of a workgroup, which shares a tile.
const WORKGROUPS: [u32; 4] = [8, 16, 32, 64];
/// Pixels that are judged, in each channel.
const SAMPLES: usize = 500;
/// Width and height of a tile.
const TILE: [usize; 2] = [LOSS_TILE_WIDTH as usize, LOSS_TILE_HEIGHT as usize];
/// Share of D-SSIM.
const LAMBDA: f64 = 0.2;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    for size in SIZES {
        let name = format!("{}x{}", size[0], size[1]);
        let forward = !wanted!(bench, loss, name, WORKGROUPS, Work::default()).is_empty();
        let backward = wanted!(bench, loss_backward, name, WORKGROUPS, Work::default());
        let sums = wanted!(bench, loss_sum, name, WORKGROUPS, Work::default());
        if !forward && backward.is_empty() && sums.is_empty() {
            continue;
        }
        let input = Input::new(bench.gpu(), size)?;
        compare(bench, &name, &input)?;
        add_up(bench, &name, &input)?;
        differentiate(bench, &name, &input)?;
    }
    Ok(())
}

/// A render and a photograph of noise about a gradient; nothing is masked.
struct Input {
    width: usize,
    height: usize,
    /// `[channel][pixel]`, 0 to 1.
    image: Vec<f32>,
    rgba: Vec<[u8; 4]>,
    /// Slopes that the gradient is made from, `[channel][pixel]`.
    slopes: Vec<[f32; 3]>,
    view: Buffer<View>,
    image_buffer: Buffer<f32>,
    photo: Buffer<u32>,
    slopes_in: Buffer<[f32; 3]>,
    slopes_out: Buffer<[f32; 3]>,
    loss_from_tile: Buffer<[f32; 4]>,
    loss: Buffer<[f32; 4]>,
    d_image: Buffer<f32>,
}

impl Input {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Input> {
        let [width, height] = size.map(|n| n as usize);
        let pixels = width * height;
        let random = &mut Random::new(pixels as u64);
        let mut rgba = Vec::with_capacity(pixels);
        for i in 0..pixels {
            let shade = 0.2 + 0.6 * (i % width) as f64 / width as f64;
            let channel = |_| ((shade + random.between(-0.1, 0.1)) * 255.0).round() as u8;
            let [r, g, b] = [0; 3].map(channel);
            rgba.push([r, g, b, 255]);
        }
        let noisy = |i: usize| f64::from(rgba[i % pixels][i / pixels]) / 255.0;
        let mut image: Vec<f32> = (0..3 * pixels)
            .map(|i| (noisy(i) + random.between(-0.1, 0.1)) as f32)
            .collect();
        // The plane of transmittance, which is not looked at.
        image.resize(4 * pixels, f32::NAN);
        let slopes: Vec<[f32; 3]> = (0..3 * pixels)
            .map(|_| [0; 3].map(|_| random.normal() as f32))
            .collect();
        let photo: Vec<u32> = rgba
            .iter()
            .map(|&pixel| u32::from_le_bytes(pixel))
            .collect();
        let view = View {
            size,
            ..View::default()
        };
        let tiles = width.div_ceil(TILE[0]) * height.div_ceil(TILE[1]);
        let terms: Vec<[f32; 4]> = (0..tiles)
            .map(|_| [0; 4].map(|_| random.between(0.0, 700.0) as f32))
            .collect();
        Ok(Input {
            width,
            height,
            view: gpu.buffer_from("view", &[view])?,
            image_buffer: gpu.buffer_from("image", &image)?,
            photo: gpu.buffer_from("photo", &photo)?,
            slopes_in: gpu.buffer_from("slopes", &slopes)?,
            slopes_out: gpu.buffer("slopes", 3 * pixels)?,
            loss_from_tile: gpu.buffer_from("loss_from_tile", &terms)?,
            loss: gpu.buffer("loss", 1)?,
            d_image: gpu.buffer("d_image", 3 * pixels)?,
            image,
            rgba,
            slopes,
        })
    }

    fn pixels(&self) -> usize {
        self.width * self.height
    }

    fn tiles(&self) -> usize {
        self.loss_from_tile.len()
    }

    /// Render and photograph at `[channel][pixel]`.
    fn pair(&self, place: usize) -> [f64; 2] {
        let (channel, pixel) = (place / self.pixels(), place % self.pixels());
        let target = f64::from(self.rgba[pixel][channel]) / 255.0;
        [f64::from(self.image[place]), target]
    }

    /// The sum of `value` over the window about a pixel, weighted; outside the image there is nothing.
    fn window<const N: usize>(&self, place: usize, value: impl Fn(usize) -> [f64; N]) -> [f64; N] {
        let gauss = |t: i64| (-((t * t) as f64) / 4.5).exp();
        let norm: f64 = (-5..=5).map(gauss).sum();
        let (base, pixel) = (place / self.pixels() * self.pixels(), place % self.pixels());
        let (x, y) = ((pixel % self.width) as i64, (pixel / self.width) as i64);
        let mut sums = [0.0; N];
        for v in (-5..=5).filter(|v| (0..self.height as i64).contains(&(y + v))) {
            for h in (-5..=5).filter(|h| (0..self.width as i64).contains(&(x + h))) {
                let weight = gauss(v) * gauss(h) / (norm * norm);
                let at = base + ((y + v) as usize) * self.width + (x + h) as usize;
                let terms = sums.iter_mut().zip(value(at));
                terms.for_each(|(sum, term)| *sum += weight * term);
            }
        }
        sums
    }

    /// SSIM of the window about a pixel, and its derivatives by the means of x, of x² and of x y.
    fn ssim(&self, place: usize) -> [f64; 4] {
        let [mx, my, xx, yy, xy] = self.window(place, |at| {
            let [x, y] = self.pair(at);
            [x, y, x * x, y * y, x * y]
        });
        let ssim = |mx: f64, xx: f64, xy: f64| {
            let luminance = (2.0 * mx * my + C1) / (mx * mx + my * my + C1);
            let spread = xx - mx * mx + yy - my * my + C2;
            luminance * (2.0 * (xy - mx * my) + C2) / spread
        };
        // Central differences, whose error of 1e-16 / 1e-6 and (1e-6)² / C2² is small here.
        let h = 1e-6;
        let slope = |[a, b, c]: [f64; 3]| {
            let at = |h: f64| ssim(mx + h * a, xx + h * b, xy + h * c);
            (at(h) - at(-h)) / (2.0 * h)
        };
        let [a, b, c] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(slope);
        [ssim(mx, xx, xy), a, b, c]
    }
}

/// SSIM's slopes at a sample of the pixels, and the terms of a sample of the tiles.
fn compare(bench: &mut Bench, name: &str, input: &Input) -> Result<()> {
    let gpu = bench.gpu().clone();
    // Three channels and the photograph in, three slopes of each channel out.
    let work = Work::of(input.pixels(), Unit::Pixels).moving(52 * input.pixels());
    for (variant, workgroup, case) in wanted!(bench, loss, name, WORKGROUPS, work) {
        let spec = loss::Spec {
            workgroup,
            ..loss::Spec::default()
        };
        let kernel = loss::Loss::new(&gpu, loss::Choice { variant, spec })?;
        let partial = gpu.buffer::<[f32; 4]>("partial", input.tiles())?;
        let io = loss::Bindings {
            view: &input.view,
            image: &input.image_buffer,
            photo: &input.photo,
            ssim_slope: &input.slopes_out,
            loss_from_tile: &partial,
        };
        let params = loss::Params { alpha_mode: 0 };
        bench.trial(
            &case,
            |rec| rec.fill(&input.slopes_out, u32::MAX),
            |rec| kernel.record(rec, io, params, Groups::Count(input.tiles() as u32)),
            || {
                let all = read(&gpu, &input.slopes_out)?;
                let (mut found, mut expected) = (Vec::new(), Vec::new());
                for place in sample(3 * input.pixels(), 3 * SAMPLES) {
                    found.extend(all[place].map(f64::from));
                    expected.extend(&input.ssim(place)[1..]);
                }
                let tiles = read(&gpu, &partial)?;
                let (terms, wanted) = tile_terms(input, &tiles);
                // See the kernel's test: slopes are up to 2 / C2.
                Ok(vec![
                    Output::relative("slopes", found, expected, 1e-3, 10.0),
                    Output::relative("tiles", terms, wanted, 1e-4, 1.0),
                ])
            },
        )?;
    }
    Ok(())
}

fn tile_terms(input: &Input, tiles: &[[f32; 4]]) -> (Vec<f64>, Vec<f64>) {
    let columns = input.width.div_ceil(TILE[0]);
    let (mut found, mut expected) = (Vec::new(), Vec::new());
    for tile in sample(tiles.len(), 6) {
        found.extend(tiles[tile].map(f64::from));
        let (left, top) = (tile % columns * TILE[0], tile / columns * TILE[1]);
        let mut sums = [0.0; 4];
        for y in top..(top + TILE[1]).min(input.height) {
            for x in left..(left + TILE[0]).min(input.width) {
                for channel in 0..3 {
                    let place = channel * input.pixels() + y * input.width + x;
                    let [a, b] = input.pair(place);
                    let terms = [
                        (a - b).abs(),
                        1.0 - input.ssim(place)[0],
                        (a - b).powi(2),
                        1.0,
                    ];
                    sums.iter_mut()
                        .zip(terms)
                        .for_each(|(sum, term)| *sum += term);
                }
            }
        }
        expected.extend(sums);
    }
    (found, expected)
}

fn add_up(bench: &mut Bench, name: &str, input: &Input) -> Result<()> {
    let gpu = bench.gpu().clone();
    let work = Work::default().moving(16 * input.tiles());
    for (variant, workgroup, case) in wanted!(bench, loss_sum, name, WORKGROUPS, work) {
        let spec = loss_sum::Spec { workgroup };
        let kernel = loss_sum::LossSum::new(&gpu, loss_sum::Choice { variant, spec })?;
        let io = loss_sum::Bindings {
            loss_from_tile: &input.loss_from_tile,
            loss: &input.loss,
        };
        let params = loss_sum::Params {
            tile_count: input.tiles() as u32,
        };
        bench.trial(
            &case,
            nothing,
            |rec| kernel.record(rec, io, params, Groups::Count(1)),
            || {
                let terms = read(&gpu, &input.loss_from_tile)?;
                let sum = |lane: usize| terms.iter().map(|t| f64::from(t[lane])).sum::<f64>();
                let found = floats(&read(&gpu, &input.loss)?);
                let expected = [0, 1, 2, 3].map(sum).into();
                Ok(vec![Output::relative("sums", found, expected, 1e-5, 1.0)])
            },
        )?;
    }
    Ok(())
}

/// From slopes that are given, so that only this kernel is judged.
fn differentiate(bench: &mut Bench, name: &str, input: &Input) -> Result<()> {
    let gpu = bench.gpu().clone();
    let work = Work::of(input.pixels(), Unit::Pixels).moving(64 * input.pixels());
    for (variant, workgroup, case) in wanted!(bench, loss_backward, name, WORKGROUPS, work) {
        let spec = loss_backward::Spec {
            workgroup,
            ..loss_backward::Spec::default()
        };
        let choice = loss_backward::Choice { variant, spec };
        let kernel = loss_backward::LossBackward::new(&gpu, choice)?;
        let io = loss_backward::Bindings {
            view: &input.view,
            image: &input.image_buffer,
            photo: &input.photo,
            ssim_slope: &input.slopes_in,
            d_image: &input.d_image,
        };
        // In units of a pixel's share.
        let params = loss_backward::Params {
            alpha_mode: 0,
            l1_scale: (1.0 - LAMBDA) as f32,
            ssim_scale: LAMBDA as f32,
        };
        bench.trial(
            &case,
            |rec| rec.fill(&input.d_image, u32::MAX),
            |rec| kernel.record(rec, io, params, Groups::Count(input.tiles() as u32)),
            || {
                let all = read(&gpu, &input.d_image)?;
                let (mut found, mut expected) = (Vec::new(), Vec::new());
                for place in sample(3 * input.pixels(), 3 * SAMPLES) {
                    let [x, y] = input.pair(place);
                    if (x - y).abs() < 1e-6 {
                        continue;
                    }
                    let [a, b, c] = input.window(place, |at| input.slopes[at].map(f64::from));
                    let d_ssim = a + 2.0 * x * b + y * c;
                    found.push(f64::from(all[place]));
                    expected.push((1.0 - LAMBDA) * (x - y).signum() - LAMBDA * d_ssim);
                }
                Ok(vec![Output::relative(
                    "d_image", found, expected, 1e-5, 1.0,
                )])
            },
        )?;
    }
    Ok(())
}
