//! Loss, its parts and its gradient: three kernels of one operation.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::{self, Random};
use crate::kernels::fitting;
use crate::kernels::{LENGTHS, supported};
use ashfall::gpu::Groups;
use ashfall::kernels::{loss, loss_backward, loss_sum};
use ashfall::layout::{LOSS_TILE_HEIGHT, LOSS_TILE_WIDTH, View};
use ashfall::reference::loss::{Target, gradient, sums, values};
use ashfall::reference::{Dual, Real, ssim};
use ashfall::scene::AlphaMode;

const LAMBDA: f64 = 0.25;

/// A render, a photograph and what its alpha means.
struct Case {
    name: &'static str,
    width: usize,
    image: Vec<[f64; 3]>,
    rgba: Vec<[u8; 4]>,
    mode: AlphaMode,
    background: [f32; 3],
}

impl Case {
    fn new(name: &'static str, width: usize, height: usize, mode: AlphaMode) -> Case {
        let random = &mut Random::new((width * height) as u64);
        let photo = scenes::photo(width as u64, width as u32, height as u32);
        let opaque = |&[r, g, b]: &[u8; 3]| [r, g, b, 255];
        Case {
            name,
            width,
            image: photo
                .iter()
                .map(|rgb| {
                    rgb.map(|c| {
                        f64::from((f64::from(c) / 255.0 + random.between(-0.2, 0.2)) as f32)
                    })
                })
                .collect(),
            rgba: photo.iter().map(opaque).collect(),
            mode,
            background: [0.25, 0.5, 1.0],
        }
    }

    fn alpha(mut self, alpha: impl Fn(usize, usize) -> u8) -> Case {
        for (i, pixel) in self.rgba.iter_mut().enumerate() {
            pixel[3] = alpha(i % self.width, i / self.width);
        }
        self
    }

    fn paint(mut self, photo: impl Fn(usize) -> u8, image: impl Fn(usize) -> f64) -> Case {
        for (i, pixel) in self.rgba.iter_mut().enumerate() {
            *pixel = [photo(i % self.width); 4];
            pixel[3] = 255;
            self.image[i] = [f64::from(image(i % self.width) as f32); 3];
        }
        self
    }

    fn height(&self) -> usize {
        self.image.len() / self.width
    }

    fn view(&self) -> View {
        View {
            size: [self.width as u32, self.height() as u32],
            background: self.background,
            ..View::default()
        }
    }

    /// The render as kernels keep it: the planes of the colours, and one of transmittance.
    fn planes(&self) -> Vec<f32> {
        let mut planes = Vec::new();
        for channel in 0..3 {
            planes.extend(self.image.iter().map(|rgb| rgb[channel] as f32));
        }
        planes.extend(self.image.iter().map(|_| f32::NAN));
        planes
    }

    fn alpha_mode(&self) -> u32 {
        u32::from(self.mode == AlphaMode::Mask)
    }

    fn with_target<T>(&self, judge: impl FnOnce(&Target<'_>) -> T) -> T {
        let (photo, mask) = values(&self.rgba, self.mode, self.background.map(f64::from));
        judge(&Target {
            width: self.width,
            photo: &photo,
            mask: mask.as_deref(),
            lambda: LAMBDA,
        })
    }
}

fn cases() -> Vec<Case> {
    use AlphaMode::{Composite, Mask};
    let corner = |x: usize, y: usize| {
        if x < 20 && y < 9 {
            0
        } else {
            (x * 7 % 256) as u8
        }
    };
    let edge = |x: usize| if x < 20 { 0 } else { 255 };
    vec![
        Case::new("one pixel", 1, 1, Composite),
        Case::new("smaller than the window", 5, 3, Composite),
        Case::new("one tile", TILE[0], TILE[1], Composite),
        Case::new(
            "a pixel more than a tile",
            TILE[0] + 1,
            TILE[1] + 1,
            Composite,
        ),
        Case::new("several tiles", 50, 107, Composite),
        Case::new("composited", 40, 33, Composite).alpha(corner),
        Case::new("masked", 40, 33, Mask).alpha(corner),
        Case::new("masked out", 18, 18, Mask).alpha(|_, _| 0),
        Case::new("a bright flat field", 40, 20, Composite).paint(|_| 250, |_| 0.97),
        Case::new("a hard edge", 40, 20, Composite)
            .paint(edge, |x| if x < 19 { 0.02 } else { 0.96 }),
        Case::new("a perfect match", 20, 20, Composite).paint(|_| 255, |_| 1.0),
    ]
}

/// Weighted values under the windows: the mean of products, by a plain double sum.
fn windowed(width: usize, values: &[f64]) -> Vec<f64> {
    let gauss = |t: i64| (-((t * t) as f64) / 4.5).exp();
    let norm: f64 = (-5..=5).map(gauss).sum();
    let height = (values.len() / width) as i64;
    let at = |x: i64, y: i64| {
        let inside = (0..width as i64).contains(&x) && (0..height).contains(&y);
        if inside {
            values[y as usize * width + x as usize]
        } else {
            0.0
        }
    };
    let mut sums = Vec::new();
    for i in 0..values.len() as i64 {
        let (x, y) = (i % width as i64, i / width as i64);
        let mut sum = 0.0;
        for v in -5..=5 {
            for h in -5..=5 {
                sum += gauss(v) * gauss(h) / (norm * norm) * at(x + h, y + v);
            }
        }
        sums.push(sum);
    }
    sums
}

/// The derivatives of SSIM by a window's mean, mean square and mean product, times the weight:
/// `[channel][pixel]`, three each.
fn slopes(case: &Case) -> Vec<f64> {
    let pixels = case.image.len();
    let mut all = vec![0.0; 9 * pixels];
    case.with_target(|target| {
        let weight = |i: usize| target.mask.map_or(1.0, |mask| mask[i]);
        for channel in 0..3 {
            let x: Vec<f64> = (0..pixels)
                .map(|i| weight(i) * case.image[i][channel])
                .collect();
            let y: Vec<f64> = (0..pixels)
                .map(|i| weight(i) * target.photo[i][channel])
                .collect();
            let times = |a: &[f64], b: &[f64]| {
                let product: Vec<f64> = a.iter().zip(b).map(|(a, b)| a * b).collect();
                windowed(case.width, &product)
            };
            let ones = vec![1.0; pixels];
            let [mx, my] = [times(&x, &ones), times(&y, &ones)];
            let [xx, yy, xy] = [times(&x, &x), times(&y, &y), times(&x, &y)];
            for i in 0..pixels {
                let of = Dual::<3>::of;
                let m = Dual::variable(mx[i], Some(0));
                let square = Dual::variable(xx[i], Some(1));
                let product = Dual::variable(xy[i], Some(2));
                let (nu, c1, c2) = (of(my[i]), of(ssim::C1), of(ssim::C2));
                let luminance = (of(2.0) * m * nu + c1) / (m * m + nu * nu + c1);
                let variances = square - m * m + of(yy[i] - my[i] * my[i]);
                let structure = (of(2.0) * (product - m * nu) + c2) / (variances + c2);
                let d = (luminance * structure).d;
                for quantity in 0..3 {
                    all[3 * (channel * pixels + i) + quantity] = weight(i) * d[quantity];
                }
            }
        }
    });
    all
}

/// A tile of the loss, in pixels.
const TILE: [usize; 2] = [LOSS_TILE_WIDTH as usize, LOSS_TILE_HEIGHT as usize];

/// Tiles that cover an image.
fn tile_count(case: &Case) -> usize {
    case.width.div_ceil(TILE[0]) * case.height().div_ceil(TILE[1])
}

/// By tile: the sums of L1, 1 - SSIM, squares and weights.
fn tile_sums(case: &Case) -> Vec<f64> {
    let columns = case.width.div_ceil(TILE[0]);
    let mut tiles = vec![0.0; 4 * tile_count(case)];
    case.with_target(|target| {
        for channel in 0..3 {
            let weight = |i: usize| target.mask.map_or(1.0, |mask| mask[i]);
            let pixels = case.image.len();
            let x: Vec<f64> = (0..pixels)
                .map(|i| weight(i) * case.image[i][channel])
                .collect();
            let y: Vec<f64> = (0..pixels)
                .map(|i| weight(i) * target.photo[i][channel])
                .collect();
            for (i, similarity) in ssim::ssim(case.width, &x, &y).into_iter().enumerate() {
                let tile = i / case.width / TILE[1] * columns + i % case.width / TILE[0];
                let difference = case.image[i][channel] - target.photo[i][channel];
                let terms = [difference.abs(), 1.0 - similarity, difference.powi(2), 1.0];
                for (lane, term) in terms.iter().enumerate() {
                    tiles[4 * tile + lane] += weight(i) * term;
                }
            }
        }
        let total: f64 = tiles.iter().skip(1).step_by(4).sum();
        let whole = sums(&case.image, target).dissimilarity;
        assert!((total - whole).abs() < 1e-9, "tiles do not add up");
    });
    tiles
}

#[test]
fn tiles_are_compared() {
    let gpu = device::gpu();
    let mut check = Check::new("loss");
    for variant in supported!(loss, gpu) {
        for (workgroup, with_ssim) in [(8, 1), (32, 1), (64, 1), (32, 0)] {
            let spec = loss::Spec {
                workgroup,
                with_ssim,
            };
            let kernel = loss::Loss::new(&gpu, loss::Choice { variant, spec }).unwrap();
            for case in cases() {
                let pixels = case.image.len();
                let mut expected = tile_sums(&case);
                let tiles = expected.len() / 4;
                let ssim = expected.iter_mut().skip(1).step_by(4);
                ssim.for_each(|sum| *sum *= f64::from(with_ssim));
                let slope = unwritten::<[f32; 3]>(&gpu, 3 * pixels);
                let partial = unwritten::<[f32; 4]>(&gpu, tiles);
                let rgba: Vec<u32> = case.rgba.iter().map(|&p| u32::from_le_bytes(p)).collect();
                let io = loss::Bindings {
                    view: &buffer(&gpu, &[case.view()]),
                    image: &buffer(&gpu, &case.planes()),
                    photo: &buffer(&gpu, &rgba),
                    ssim_slope: &slope,
                    loss_from_tile: &partial,
                };
                let params = loss::Params {
                    alpha_mode: case.alpha_mode(),
                };
                gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(tiles as u32)))
                    .unwrap();
                let wanted = slopes(&case);
                let scale = rms(&wanted).max(1.0);
                // Moments of values up to 1 have an error of about 6u; variances are compared with C2 = 9e-4, so
                // that SSIM is off by 4e-4 at worst, in a window of a single bright shade beside another tile's
                // shift, and its slopes, which are up to 2 / C2, likewise.
                let tiles =
                    Output::relative("tiles", floats(&read(&gpu, &partial)), expected, 1e-4, 1.0);
                let mut outputs = vec![tiles];
                if with_ssim != 0 {
                    let found = floats(&read(&gpu, &slope));
                    outputs.push(Output::relative("slopes", found, wanted, 1e-3, scale));
                }
                check.outputs(case.name, outputs);
            }
        }
    }
    check.finish();
}

#[test]
fn pixels_get_their_gradient() {
    let gpu = device::gpu();
    let mut check = Check::new("loss_backward");
    for variant in supported!(loss_backward, gpu) {
        for (workgroup, lambda) in [(8, LAMBDA), (32, LAMBDA), (64, LAMBDA), (32, 0.0)] {
            let spec = loss_backward::Spec {
                workgroup,
                with_ssim: u32::from(lambda > 0.0),
            };
            let choice = loss_backward::Choice { variant, spec };
            let kernel = loss_backward::LossBackward::new(&gpu, choice).unwrap();
            for case in cases() {
                let pixels = case.image.len();
                let d_image = unwritten::<f32>(&gpu, 3 * pixels);
                let rgba: Vec<u32> = case.rgba.iter().map(|&p| u32::from_le_bytes(p)).collect();
                let flat: Vec<f32> = slopes(&case).iter().map(|&s| s as f32).collect();
                let slopes: &[[f32; 3]] = bytemuck::cast_slice(&flat);
                let io = loss_backward::Bindings {
                    view: &buffer(&gpu, &[case.view()]),
                    image: &buffer(&gpu, &case.planes()),
                    photo: &buffer(&gpu, &rgba),
                    ssim_slope: &buffer(&gpu, slopes),
                    d_image: &d_image,
                };
                let (expected, weight, photo) = case.with_target(|target| {
                    let target = &Target { lambda, ..*target };
                    let weight = sums(&case.image, target).weight;
                    (gradient(&case.image, target), weight, target.photo.to_vec())
                });
                let share = if weight > 0.0 { 1.0 / weight } else { 0.0 };
                let params = loss_backward::Params {
                    alpha_mode: case.alpha_mode(),
                    l1_scale: ((1.0 - lambda) * share) as f32,
                    ssim_scale: (lambda * share) as f32,
                };
                let tiles = tile_count(&case);
                gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(tiles as u32)))
                    .unwrap();
                let planar = |image: &[[f64; 3]]| -> Vec<f64> {
                    (0..3)
                        .flat_map(|c| image.iter().map(move |rgb| rgb[c]))
                        .collect()
                };
                let near = planar(&case.image)
                    .iter()
                    .zip(planar(&photo))
                    .map(|(x, y)| *x != y && (x - y).abs() < 1e-6)
                    .collect();
                // In units of a pixel's share: slopes are up to 2 / C2 = 2200 and cancel between the three, which
                // leaves 2200 · 2u of rounding.
                let found: Vec<f64> = floats(&read(&gpu, &d_image));
                let in_shares = |list: Vec<f64>| -> Vec<f64> {
                    let unit = if weight > 0.0 { weight } else { 1.0 };
                    list.iter().map(|d| d * unit).collect()
                };
                check.outputs(
                    case.name,
                    vec![
                        Output::relative(
                            "d_image",
                            in_shares(found),
                            in_shares(planar(&expected)),
                            3e-4,
                            1.0,
                        )
                        .near(near, 2.0, 0.01),
                    ],
                );
            }
        }
    }
    check.finish();
}

#[test]
fn tiles_are_added_up() {
    let gpu = device::gpu();
    let mut check = Check::new("loss_sum");
    for variant in supported!(loss_sum, gpu) {
        for workgroup in fitting(&gpu, [1, 8, 64, 256]) {
            let spec = loss_sum::Spec { workgroup };
            let choice = loss_sum::Choice { variant, spec };
            let kernel = loss_sum::LossSum::new(&gpu, choice).unwrap();
            for (name, len) in LENGTHS {
                let random = &mut Random::new(len as u64);
                let tiles: Vec<[f32; 4]> = (0..len)
                    .map(|_| [0; 4].map(|_| random.between(0.0, 700.0) as f32))
                    .collect();
                let total = unwritten::<[f32; 4]>(&gpu, 1);
                let io = loss_sum::Bindings {
                    loss_from_tile: &buffer(&gpu, &tiles),
                    loss: &total,
                };
                let params = loss_sum::Params {
                    tile_count: len as u32,
                };
                gpu.run(|rec| kernel.record(rec, io, params, Groups::Count(1)))
                    .unwrap();
                let sum = |lane: usize| tiles.iter().map(|t| f64::from(t[lane])).sum::<f64>();
                let found = floats(&read(&gpu, &total));
                // Random rounding of `len` positive terms: sqrt(len) u, at 5000 terms one after the other.
                let expected = [0, 1, 2, 3].map(sum).to_vec();
                check.outputs(
                    name,
                    vec![Output::relative("total", found, expected, 1e-5, 1.0)],
                );
            }
        }
    }
    check.finish();
}
