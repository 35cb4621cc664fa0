//! A render and its photograph, as the kernels of the loss and their references see them.

use crate::Result;
use crate::gpu::{Buffer, Gpu};
use crate::lab::bench::input::random::Random;
use crate::layout::{LOSS_TILE_HEIGHT, LOSS_TILE_WIDTH, View};
use crate::reference::loss::{Exposure, values};
use crate::reference::ssim::{C1, C2};
use crate::reference::{Dual, Real};
use crate::scene::AlphaMode;

/// Width and height of a tile.
pub const TILE: [usize; 2] = [LOSS_TILE_WIDTH as usize, LOSS_TILE_HEIGHT as usize];
/// Pixels along a side of a patch, and log2 of them.
pub const PATCH: usize = 1 << PATCH_SHIFT;
pub(super) const PATCH_SHIFT: u32 = 3;

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
    pub(super) fn tiles(&self) -> usize {
        self.width.div_ceil(TILE[0]) * self.height().div_ceil(TILE[1])
    }

    /// Rows of tiles.
    pub(super) fn tile_rows(&self) -> u32 {
        self.height().div_ceil(TILE[1]) as u32
    }

    /// Photograph and weight of each pixel.
    pub(super) fn target(&self) -> WindowTarget<'_> {
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
    pub(super) fn grid(&self) -> [usize; 2] {
        [self.width, self.height()].map(|side| side.div_ceil(self.stride))
    }

    /// Pixel of a channel, `[channel][pixel]`, that a window at `[channel][row][column]` is about; `None` beyond the
    /// image.
    pub(super) fn center(&self, window: usize) -> Option<usize> {
        let [columns, rows] = self.grid();
        let (channel, row, column) = (window / columns / rows, window / columns % rows, window % columns);
        let [x, y] = [
            column * self.stride + self.offset[0],
            row * self.stride + self.offset[1],
        ];
        (x < self.width && y < self.height()).then(|| channel * self.image.len() + y * self.width + x)
    }

    /// Weight of the window about a pixel: 0 if there is none.
    pub(super) fn share(&self, pixel: usize) -> f64 {
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

    /// Slopes of the windows: exact ones of a small image, of a large one noise, which costs the reference nothing.
    pub(super) fn given_slopes(&self, target: &WindowTarget<'_>) -> Vec<[f32; 3]> {
        let random = &mut Random::new(8);
        let is_small = self.image.len() < 10_000;
        let slope = |window: usize| match self.center(window) {
            Some(place) if is_small => target.slopes(place).map(|d| d as f32),
            Some(_) => [0; 3].map(|_| random.normal() as f32),
            None => [f32::NAN; 3],
        };
        (0..3 * self.grid().iter().product::<usize>()).map(slope).collect()
    }

    /// Slopes at their pixels, `[channel][pixel]`; zeros between the windows.
    pub(super) fn slope_from_place(&self, slopes: &[[f32; 3]]) -> Vec<[f64; 3]> {
        let mut slope_from_place = vec![[0.0; 3]; 3 * self.image.len()];
        for (window, slope) in slopes.iter().enumerate() {
            if let Some(place) = self.center(window) {
                slope_from_place[place] = slope.map(f64::from);
            }
        }
        slope_from_place
    }

    pub(super) fn push_offset(&self) -> [u32; 2] {
        self.offset.map(|offset| offset as u32)
    }

    pub(super) fn alpha_mode(&self) -> u32 {
        u32::from(self.mode == AlphaMode::Mask)
    }
}

/// The photograph as the loss compares it, by plain double sums under the windows.
pub(super) struct WindowTarget<'a> {
    of: &'a ImagePair,
    pub(super) photo: Vec<[f64; 3]>,
    mask: Option<Vec<f64>>,
}

impl WindowTarget<'_> {
    pub(super) fn pixels(&self) -> usize {
        self.photo.len()
    }

    pub(super) fn weight(&self, pixel: usize) -> f64 {
        self.of.kept(pixel) * self.mask.as_ref().map_or(1.0, |mask| mask[pixel])
    }

    /// Weight of all channels, and its reciprocal, 0 without.
    pub(super) fn total(&self) -> (f64, f64) {
        let weight: f64 = 3.0 * (0..self.pixels()).map(|i| self.weight(i)).sum::<f64>();
        (weight, if weight > 0.0 { 1.0 / weight } else { 0.0 })
    }

    /// Render under the exposure, and photograph, at `[channel][pixel]`.
    pub(super) fn pair(&self, place: usize) -> [f64; 2] {
        let (x, y) = self.exposed(place);
        [x.v, y]
    }

    /// Render under the exposure, with its derivative by the plain one, and photograph.
    pub(super) fn exposed(&self, place: usize) -> (Dual<1>, f64) {
        let (channel, pixel) = (place / self.pixels(), place % self.pixels());
        let x = Dual::variable(self.of.image[pixel][channel], Some(0));
        let y = self.photo[pixel][channel];
        let exposure = self.of.exposure();
        (exposure.map_or(x, |exposure| exposure.of(channel, x, y)), y)
    }

    /// True where rounding may choose another line of the exposure, or another side of the photograph.
    pub(super) fn is_at_a_kink(&self, place: usize) -> bool {
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
    pub(super) fn window<const N: usize>(&self, place: usize, value: impl Fn(usize) -> [f64; N]) -> [f64; N] {
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
    pub(super) fn ssim(&self, place: usize) -> Dual<3> {
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
    pub(super) fn slopes(&self, place: usize) -> [f64; 3] {
        let pixel = place % self.pixels();
        let weight = self.weight(pixel) * self.of.share(pixel);
        self.ssim(place).d.map(|d| weight * d)
    }

    /// Sums over a tile of L1, 1 − SSIM, squares and weights.
    pub(super) fn tile(&self, tile: usize) -> [f64; 4] {
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
