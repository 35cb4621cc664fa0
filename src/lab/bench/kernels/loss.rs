//! Cases of the loss: its parts, their sums, and its gradient.

use super::{KernelCase, Workgroups, sample, time};
use crate::Result;
use crate::gpu::{Buffer, Gpu, Groups};
use crate::kernels::{loss, loss_backward, loss_sum};
use crate::lab::bench::check::{Output, floats, rms};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::{Bench, Work};
use crate::layout::{LOSS_TILE_HEIGHT, LOSS_TILE_WIDTH, View};
use crate::reference::loss::{Exposure, values};
use crate::reference::ssim::{C1, C2};
use crate::reference::{Dual, Real};
use crate::scene::AlphaMode;
use std::rc::Rc;

/// Width and height of a tile.
pub const TILE: [usize; 2] = [LOSS_TILE_WIDTH as usize, LOSS_TILE_HEIGHT as usize];
/// Places, pixels of channels, that are compared.
const SAMPLES: usize = 20_000;
/// Pixels along a side of a patch, and log2 of them.
pub const PATCH: usize = 1 << PATCH_SHIFT;
pub(super) const PATCH_SHIFT: u32 = 3;
/// Share of D-SSIM.
pub const LAMBDA: f64 = 0.25;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    let workgroups = Workgroups::any(&[8, 16, 32, 64]);
    for [width, height] in [[480, 272], [1920, 1080]] {
        let name = format!("{width}x{height}");
        let shaded = std::cell::LazyCell::new(|| ImagePair::shaded(width, height));
        time(bench, workgroups, &name, |gpu| compare(gpu, &shaded, true))?;
        let tiles = width.div_ceil(TILE[0]) * height.div_ceil(TILE[1]);
        time(bench, workgroups, &name, |gpu| sum(gpu, tiles, WHOLE))?;
        time(bench, workgroups, &name, |gpu| differentiate(gpu, &shaded, LAMBDA))?;
        let name = format!("{name}/lattice");
        let lattice = std::cell::LazyCell::new(|| ImagePair {
            stride: 2,
            ..ImagePair::shaded(width, height)
        });
        time(bench, workgroups, &name, |gpu| compare(gpu, &lattice, true))?;
        time(bench, workgroups, &name, |gpu| differentiate(gpu, &lattice, LAMBDA))?;
    }
    Ok(())
}

/// A render, a photograph and the meaning of its alpha.
pub struct ImagePair {
    /// Pixels of a row.
    pub width: usize,
    /// The render, 0 to 1.
    pub image: Vec<[f64; 3]>,
    /// The photograph.
    pub rgba: Vec<[u8; 4]>,
    /// Meaning of the photograph's alpha.
    pub mode: AlphaMode,
    /// Colour behind transparent pixels.
    pub background: [f32; 3],
    /// Exposure of the photograph; `None`: the kernels work without.
    pub gain: Option<[f32; 3]>,
    /// Distance of SSIM's windows, pixels.
    pub stride: usize,
    /// First window in x and y.
    pub offset: [usize; 2],
    /// Patches of [`PATCH`] pixels along a side that are left out; empty: none.
    pub ignored: Vec<bool>,
}

impl ImagePair {
    /// Noise about a gradient; nothing is masked.
    pub(super) fn shaded(width: usize, height: usize) -> ImagePair {
        let random = &mut Random::new((width * height) as u64);
        let (mut rgba, mut image) = (Vec::new(), Vec::new());
        for i in 0..width * height {
            let shade = 0.2 + 0.6 * (i % width) as f64 / width as f64;
            let channel = |_| ((shade + random.between(-0.1, 0.1)) * 255.0).round() as u8;
            let [r, g, b] = [0; 3].map(channel);
            rgba.push([r, g, b, 255]);
            let noisy = |c: u8| f64::from((f64::from(c) / 255.0 + random.between(-0.1, 0.1)) as f32);
            image.push([r, g, b].map(noisy));
        }
        ImagePair {
            width,
            image,
            rgba,
            mode: AlphaMode::Composite,
            background: [0.25, 0.5, 1.0],
            gain: None,
            stride: 1,
            offset: [0; 2],
            ignored: Vec::new(),
        }
    }

    /// Weight of a pixel's patch.
    pub(super) fn kept(&self, pixel: usize) -> f64 {
        let (column, row) = (pixel % self.width / PATCH, pixel / self.width / PATCH);
        let is_ignored = self.ignored.get(row * self.columns() + column);
        if is_ignored == Some(&true) { 0.0 } else { 1.0 }
    }

    /// Patches in a row.
    pub(super) fn columns(&self) -> usize {
        self.width.div_ceil(PATCH)
    }

    /// Uploads a bit of each patch.
    pub(super) fn upload_ignored(&self, gpu: &Gpu) -> Result<Buffer<u32>> {
        let mut words = vec![0; (self.columns() * self.height().div_ceil(PATCH)).div_ceil(32)];
        for (patch, _) in self.ignored.iter().enumerate().filter(|(_, ignored)| **ignored) {
            words[patch / 32] |= 1 << (patch % 32);
        }
        gpu.buffer_from("ignored", &words)
    }

    /// Target and weights as the reference reads them, without those of patches.
    pub(super) fn values(&self) -> (Vec<[f64; 3]>, Option<Vec<f64>>) {
        values(&self.rgba, self.mode, self.background.map(f64::from))
    }

    pub(super) fn exposure(&self) -> Option<Exposure> {
        let gain = self.gain?.map(f64::from);
        Some(Exposure { gain })
    }

    /// Gains, and slopes on the curve's toe.
    pub(super) fn push(&self) -> [[f32; 3]; 2] {
        let gain = self.gain.unwrap_or([1.0; 3]);
        [gain, gain.map(|g| f64::from(g).powf(2.4) as f32)]
    }

    pub(super) fn height(&self) -> usize {
        self.image.len() / self.width
    }

    /// Tiles that cover the image.
    fn tiles(&self) -> usize {
        self.width.div_ceil(TILE[0]) * self.height().div_ceil(TILE[1])
    }

    /// Photograph and weight of each pixel.
    fn target(&self) -> WindowTarget<'_> {
        let (photo, mask) = self.values();
        WindowTarget { of: self, photo, mask }
    }

    pub(super) fn upload(&self, gpu: &Gpu) -> Result<(Buffer<View>, Buffer<f32>, Buffer<u32>)> {
        let view = View {
            size: [self.width as u32, self.height() as u32],
            background: self.background,
            ..View::default()
        };
        let mut planes = Vec::new();
        for channel in 0..3 {
            planes.extend(self.image.iter().map(|rgb| rgb[channel] as f32));
        }
        // The plane of transmittance, which is not read.
        planes.extend(self.image.iter().map(|_| f32::NAN));
        let rgba: Vec<u32> = self.rgba.iter().map(|&p| u32::from_le_bytes(p)).collect();
        Ok((
            gpu.buffer_from("view", &[view])?,
            gpu.buffer_from("image", &planes)?,
            gpu.buffer_from("photo", &rgba)?,
        ))
    }

    /// Columns and rows of windows.
    fn grid(&self) -> [usize; 2] {
        [self.width, self.height()].map(|side| side.div_ceil(self.stride))
    }

    /// Pixel of a channel, `[channel][pixel]`, that a window at `[channel][row][column]` is about; `None` beyond the
    /// image.
    fn center(&self, window: usize) -> Option<usize> {
        let [columns, rows] = self.grid();
        let (channel, row, column) = (window / columns / rows, window / columns % rows, window % columns);
        let [x, y] = [
            column * self.stride + self.offset[0],
            row * self.stride + self.offset[1],
        ];
        (x < self.width && y < self.height()).then(|| channel * self.image.len() + y * self.width + x)
    }

    /// Weight of the window about a pixel: 0 if there is none.
    fn share(&self, pixel: usize) -> f64 {
        let is_center = [pixel % self.width, pixel / self.width]
            .iter()
            .zip(self.offset)
            .all(|(at, offset)| at % self.stride == offset);
        if is_center {
            (self.stride * self.stride) as f64
        } else {
            0.0
        }
    }

    fn push_offset(&self) -> [u32; 2] {
        self.offset.map(|offset| offset as u32)
    }

    pub(super) fn alpha_mode(&self) -> u32 {
        u32::from(self.mode == AlphaMode::Mask)
    }
}

/// The photograph as the loss compares it, by plain double sums under the windows.
struct WindowTarget<'a> {
    of: &'a ImagePair,
    photo: Vec<[f64; 3]>,
    mask: Option<Vec<f64>>,
}

impl WindowTarget<'_> {
    fn pixels(&self) -> usize {
        self.photo.len()
    }

    fn weight(&self, pixel: usize) -> f64 {
        self.of.kept(pixel) * self.mask.as_ref().map_or(1.0, |mask| mask[pixel])
    }

    /// Weight of all channels, and its reciprocal, 0 without.
    fn total(&self) -> (f64, f64) {
        let weight: f64 = 3.0 * (0..self.pixels()).map(|i| self.weight(i)).sum::<f64>();
        (weight, if weight > 0.0 { 1.0 / weight } else { 0.0 })
    }

    /// Render under the exposure, and photograph, at `[channel][pixel]`.
    fn pair(&self, place: usize) -> [f64; 2] {
        let (x, y) = self.exposed(place);
        [x.v, y]
    }

    /// Render under the exposure, with its derivative by the plain one, and photograph.
    fn exposed(&self, place: usize) -> (Dual<1>, f64) {
        let (channel, pixel) = (place / self.pixels(), place % self.pixels());
        let x = Dual::variable(self.of.image[pixel][channel], Some(0));
        let y = self.photo[pixel][channel];
        let exposure = self.of.exposure();
        (exposure.map_or(x, |exposure| exposure.of(channel, x, y)), y)
    }

    /// True where rounding may choose another line of the exposure, or another side of the photograph.
    fn is_at_a_kink(&self, place: usize) -> bool {
        let (channel, pixel) = (place / self.pixels(), place % self.pixels());
        let at = |dx: f64| {
            let (x, y) = (self.of.image[pixel][channel] + dx, self.photo[pixel][channel]);
            let x = Dual::<1>::variable(x, Some(0));
            let exposed = self.of.exposure().map_or(x, |exposure| exposure.of(channel, x, y));
            (exposed.d, (exposed.v - y).signum(), exposed.v == y)
        };
        at(-1e-6) != at(1e-6)
    }

    /// The sum of `value` over the window about a pixel, weighted; outside the image there is nothing.
    fn window<const N: usize>(&self, place: usize, value: impl Fn(usize) -> [f64; N]) -> [f64; N] {
        let gauss = |t: i64| (-((t * t) as f64) / 4.5).exp();
        let norm: f64 = (-5..=5).map(gauss).sum();
        let (base, pixel) = (place / self.pixels() * self.pixels(), place % self.pixels());
        let (width, height) = (self.of.width as i64, self.of.height() as i64);
        let (x, y) = (pixel as i64 % width, pixel as i64 / width);
        let mut sums = [0.0; N];
        for v in (-5..=5).filter(|v| (0..height).contains(&(y + v))) {
            for h in (-5..=5).filter(|h| (0..width).contains(&(x + h))) {
                let weight = gauss(v) * gauss(h) / (norm * norm);
                let at = base + ((y + v) * width + x + h) as usize;
                let terms = sums.iter_mut().zip(value(at));
                terms.for_each(|(sum, term)| *sum += weight * term);
            }
        }
        sums
    }

    /// SSIM of the window about a pixel, and its derivatives by the means of x, of x² and of x y.
    fn ssim(&self, place: usize) -> Dual<3> {
        let [mx, my, xx, yy, xy] = self.window(place, |at| {
            let weight = self.weight(at % self.pixels());
            let [x, y] = self.pair(at).map(|value| weight * value);
            [x, y, x * x, y * y, x * y]
        });
        let of = Dual::<3>::of;
        let m = Dual::variable(mx, Some(0));
        let square = Dual::variable(xx, Some(1));
        let product = Dual::variable(xy, Some(2));
        let (nu, c1, c2) = (of(my), of(C1), of(C2));
        let luminance = (of(2.0) * m * nu + c1) / (m * m + nu * nu + c1);
        let variances = square - m * m + of(yy - my * my);
        let structure = (of(2.0) * (product - m * nu) + c2) / (variances + c2);
        luminance * structure
    }

    /// Derivatives of SSIM times the weight, an output of the forward pass and input of the backward one.
    fn slopes(&self, place: usize) -> [f64; 3] {
        let pixel = place % self.pixels();
        let weight = self.weight(pixel) * self.of.share(pixel);
        self.ssim(place).d.map(|d| weight * d)
    }

    /// Sums over a tile of L1, 1 − SSIM, squares and weights.
    fn tile(&self, tile: usize) -> [f64; 4] {
        let columns = self.of.width.div_ceil(TILE[0]);
        let (left, top) = (tile % columns * TILE[0], tile / columns * TILE[1]);
        let mut sums = [0.0; 4];
        for y in top..(top + TILE[1]).min(self.of.height()) {
            for x in left..(left + TILE[0]).min(self.of.width) {
                for channel in 0..3 {
                    let pixel = y * self.of.width + x;
                    let place = channel * self.pixels() + pixel;
                    let [a, b] = self.pair(place);
                    let dissimilarity = match self.of.share(pixel) {
                        0.0 => 0.0,
                        share => share * (1.0 - self.ssim(place).v),
                    };
                    let terms = [(a - b).abs(), dissimilarity, (a - b).powi(2), 1.0];
                    let pairs = sums.iter_mut().zip(terms);
                    pairs.for_each(|(sum, term)| *sum += self.weight(pixel) * term);
                }
            }
        }
        sums
    }
}

/// Sums by tile, and with `with_ssim` SSIM's slopes.
pub fn compare<'a>(gpu: &Gpu, of: &'a ImagePair, with_ssim: bool) -> Result<KernelCase<'a, loss::Loss>> {
    let (pixels, tiles) = (of.image.len(), of.tiles());
    let (view, image, photo) = of.upload(gpu)?;
    let windows = 3 * of.grid().iter().product::<usize>();
    let slopes = gpu.buffer::<[f32; 3]>("ssim_slope", windows)?;
    let ignored = of.upload_ignored(gpu)?;
    let sums = gpu.buffer::<[f32; 4]>("loss_from_tile", tiles)?;
    let (target, alpha_mode) = (Rc::new(of.target()), of.alpha_mode());
    let by_place = target.clone();
    // Three channels and the photograph in, three slopes of each channel out.
    let case = KernelCase::new(Work::of(pixels, "pixels").moving(52 * pixels))
        .tune(move |choice: &mut loss::Choice| {
            choice.spec.with_ssim = with_ssim.into();
            choice.spec.stride = of.stride as u32;
            choice.spec.with_exposure = of.gain.is_some().into();
            choice.spec.with_ignored = u32::from(!of.ignored.is_empty());
        })
        .compare(&sums, move |all| {
            let [mut found, mut expected] = [(); 2].map(|()| Vec::new());
            for tile in sample(tiles, 40) {
                let mut sums = target.tile(tile);
                sums[1] *= f64::from(u8::from(with_ssim));
                found.extend(all[tile].map(f64::from));
                expected.extend(sums);
            }
            // Moments of values up to 1 have an error of about 6u; variances are compared with C2 = 9e-4, so that
            // SSIM is off by 4e-4 at worst, in a window of a single bright shade beside another tile's shift, and its
            // slopes, which are up to 2 / C2, likewise.
            vec![Output::relative("tiles", found, expected, 1e-4, 1.0)]
        })
        .compare(&slopes, move |all| {
            let [mut found, mut expected] = [(); 2].map(|()| Vec::new());
            for window in sample(windows, SAMPLES).filter(|_| with_ssim) {
                if let Some(place) = of.center(window) {
                    found.extend(all[window].map(f64::from));
                    expected.extend(by_place.slopes(place));
                }
            }
            let scale = rms(&expected).max(1.0);
            vec![Output::relative("slopes", found, expected, 1e-3, scale)]
        });
    Ok(case.commands(move |rec, kernel: &loss::Loss, _| {
        let io = loss::Bindings {
            view: &view,
            image: &image,
            photo: &photo,
            ssim_slope: &slopes,
            loss_from_tile: &sums,
            ignored: &ignored,
        };
        let [gain, toe] = of.push();
        let offset = of.push_offset();
        let params = loss::Params {
            alpha_mode,
            gain,
            toe,
            offset,
            patch_shift: PATCH_SHIFT,
            patch_columns: of.columns() as u32,
        };
        kernel.record(rec, io, params, Groups::Count(tiles as u32));
    }))
}

/// Place of the first tile's terms, distance to the next, place of the total: those of the loss.
pub const WHOLE: [u32; 3] = [0, 1, 0];

/// Random sums of tiles, added up: those of every `stride`-th place.
pub fn sum<'a>(gpu: &Gpu, tiles: usize, places: [u32; 3]) -> Result<KernelCase<'a, loss_sum::LossSum>> {
    let [first, stride, slot] = places;
    let random = &mut Random::new(tiles as u64);
    let mut four = || [0; 4].map(|_| random.between(0.0, 700.0) as f32);
    let terms: Vec<[f32; 4]> = (0..tiles * stride as usize).map(|_| four()).collect();
    let every = || terms.iter().skip(first as usize).step_by(stride as usize);
    let sum = |lane: usize| every().map(|t| f64::from(t[lane])).sum::<f64>();
    let expected = [0, 1, 2, 3].map(sum).to_vec();
    let loss_from_tile = gpu.buffer_from("loss_from_tile", &terms)?;
    let total = gpu.buffer::<[f32; 4]>("loss", slot as usize + 1)?;
    // Random rounding of as many positive terms: sqrt(tiles) u, at 5000 terms one after the other.
    let case = KernelCase::new(Work::default().moving(16 * tiles)).compare(&total, move |found| {
        let last = &found[slot as usize..];
        vec![Output::relative("total", floats(last), expected.clone(), 1e-5, 1.0)]
    });
    Ok(case.commands(move |rec, kernel: &loss_sum::LossSum, _| {
        let io = loss_sum::Bindings {
            loss_from_tile: &loss_from_tile,
            total: &total,
        };
        let params = loss_sum::Params {
            tile_count: tiles as u32,
            first,
            stride,
            slot,
        };
        kernel.record(rec, io, params, Groups::Count(1));
    }))
}

/// The gradient from slopes that are given, so that only this kernel is judged.
pub fn differentiate<'a>(
    gpu: &Gpu,
    of: &'a ImagePair,
    lambda: f64,
) -> Result<KernelCase<'a, loss_backward::LossBackward>> {
    let (pixels, target) = (of.image.len(), of.target());
    let (weight, share) = target.total();
    // Exact slopes of a small image; of a large one noise, which costs the reference nothing.
    let random = &mut Random::new(8);
    let slopes: Vec<[f32; 3]> = (0..3 * of.grid().iter().product::<usize>())
        .map(|window| match of.center(window) {
            Some(place) if pixels < 10_000 => target.slopes(place).map(|d| d as f32),
            Some(_) => [0; 3].map(|_| random.normal() as f32),
            None => [f32::NAN; 3],
        })
        .collect();
    let mut slope_of = vec![[0.0; 3]; 3 * pixels];
    for (window, slope) in slopes.iter().enumerate() {
        if let Some(place) = of.center(window) {
            slope_of[place] = slope.map(f64::from);
        }
    }
    let (view, image, photo) = of.upload(gpu)?;
    let ignored = of.upload_ignored(gpu)?;
    let ssim_slope = gpu.buffer_from("ssim_slope", &slopes)?;
    let d_image = gpu.buffer::<f32>("d_image", 3 * pixels)?;
    let tiles = of.tiles() as u32;
    let [gain, toe] = of.push();
    let steepest = toe.into_iter().fold(1.0, f32::max).into();
    let params = loss_backward::Params {
        alpha_mode: of.alpha_mode(),
        l1_scale: ((1.0 - lambda) * share) as f32,
        ssim_scale: (lambda * share) as f32,
        gain,
        toe,
        offset: of.push_offset(),
        patch_shift: PATCH_SHIFT,
        patch_columns: of.columns() as u32,
    };
    let case = KernelCase::new(Work::of(pixels, "pixels").moving(64 * pixels)).tune(
        move |choice: &mut loss_backward::Choice| {
            choice.spec.with_ssim = u32::from(lambda > 0.0);
            choice.spec.stride = of.stride as u32;
            choice.spec.with_exposure = of.gain.is_some().into();
            choice.spec.with_ignored = u32::from(!of.ignored.is_empty());
        },
    );
    let case = case.compare(&d_image, move |all| {
        let (mut found, mut expected, mut near) = (Vec::new(), Vec::new(), Vec::new());
        for place in sample(3 * pixels, SAMPLES) {
            let weight_here = target.weight(place % pixels);
            let (exposed, y) = target.exposed(place);
            let x = exposed.v;
            let [a, b, c] = target.window(place, |at| slope_of[at]);
            // The slopes are those by weighted values.
            let d_ssim = a + 2.0 * weight_here * x * b + weight_here * y * c;
            let sign = if x == y { 0.0 } else { (x - y).signum() };
            // In units of a pixel's share: slopes are up to 2 / C2 = 2200 and cancel between the three: 2200 · 2u.
            let unit = if weight > 0.0 { weight } else { 1.0 };
            found.push(f64::from(all[place]) * unit);
            let terms = (1.0 - lambda) * sign - lambda * d_ssim;
            expected.push(exposed.d[0] * terms * weight_here * share * unit);
            near.push(x != y && (x - y).abs() < 1e-6 || target.is_at_a_kink(place));
        }
        let d_image = Output::relative("d_image", found, expected, 3e-4, steepest);
        vec![d_image.near(near, 2.0 * steepest, 0.01)]
    });
    Ok(case.commands(move |rec, kernel: &loss_backward::LossBackward, _| {
        let io = loss_backward::Bindings {
            view: &view,
            image: &image,
            photo: &photo,
            ssim_slope: &ssim_slope,
            d_image: &d_image,
            ignored: &ignored,
        };
        kernel.record(rec, io, params, Groups::Count(tiles));
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::loss;

    /// The windows here and those of the reference's loss are the same.
    #[test]
    fn tiles_add_up_to_the_reference() {
        let of = ImagePair::shaded(37, 29);
        let target = of.target();
        let whole = loss::sums(&of.image, &loss::Target::new(37, &target.photo));
        let tiles = (0..of.tiles()).map(|tile| target.tile(tile));
        let sums = tiles.fold([0.0; 4], |a, b| [0, 1, 2, 3].map(|i| a[i] + b[i]));
        let expected = [whole.l1, whole.dissimilarity, whole.squared, whole.weight];
        for (sum, expected) in sums.iter().zip(expected) {
            assert!((sum - expected).abs() < 1e-9, "{sum}, not {expected}");
        }
    }
}
