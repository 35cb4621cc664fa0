//! Cases of the loss: its parts, their sums, and its gradient.

use super::image_pair::PATCH_SHIFT;
pub use super::image_pair::{ImagePair, PATCH, TILE};
use super::{KernelCase, Workgroups, sample, time};
use crate::Result;
use crate::gpu::{Gpu, Groups};
use crate::kernels::{loss, loss_backward, loss_sum};
use crate::lab::bench::check::{Output, floats, rms};
use crate::lab::bench::input::random::Random;
use crate::lab::bench::{Bench, Work};
use std::rc::Rc;

/// Places, pixels of channels, that are compared.
const SAMPLES: usize = 20_000;
/// Share of D-SSIM.
pub const LAMBDA: f64 = 0.25;

pub(super) fn run(bench: &mut Bench) -> Result<()> {
    let workgroups = Workgroups::any(&[8, 16, 32, 64, 128]);
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
            choice.spec.strip = loss::strip_of(choice.spec.workgroup);
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
            photo_first: 0,
            photo_rows: of.height() as u32,
            counted: [0, of.height() as u32],
            tile_row: 0,
            tile_rows: of.tile_rows(),
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
    let slopes = of.given_slopes(&target);
    let slope_from_place = of.slope_from_place(&slopes);
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
        photo_first: 0,
        tile_row: 0,
        tile_rows: of.tile_rows(),
    };
    let case = KernelCase::new(Work::of(pixels, "pixels").moving(64 * pixels)).tune(
        move |choice: &mut loss_backward::Choice| {
            choice.spec.with_ssim = u32::from(lambda > 0.0);
            choice.spec.stride = of.stride as u32;
            choice.spec.strip = loss::strip_of(choice.spec.workgroup);
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
            let [a, b, c] = target.window(place, |at| slope_from_place[at]);
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
