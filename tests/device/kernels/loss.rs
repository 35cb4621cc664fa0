//! Loss, its parts and its gradient: three kernels of one operation.

use crate::common::check::*;
use crate::common::device;
use crate::common::scenes::{self, Random};
use crate::kernels::{ELEMENTWISE, by_length};
use ashfall::lab::bench::kernels::Workgroups;
use ashfall::lab::bench::kernels::loss::{ImagePair, LAMBDA, PATCH, TILE, WHOLE, compare, differentiate, sum};
use ashfall::lab::bench::kernels::photo_sums::{expose, residual};
use ashfall::scene::AlphaMode::{self, Composite, Mask};

/// A photograph, and a render that differs by noise.
fn noisy(width: usize, height: usize, mode: AlphaMode) -> ImagePair {
    let random = &mut Random::new((width * height) as u64);
    let photo = scenes::photo(width as u64, width as u32, height as u32);
    let mut value = |c: u8| f64::from((f64::from(c) / 255.0 + random.between(-0.2, 0.2)) as f32);
    ImagePair {
        width,
        image: photo.iter().map(|rgb| rgb.map(&mut value)).collect(),
        rgba: photo.iter().map(|&[r, g, b]| [r, g, b, 255]).collect(),
        mode,
        background: [0.25, 0.5, 1.0],
        gain: None,
        stride: 1,
        offset: [0; 2],
        ignored: Vec::new(),
    }
}

/// The same without every third patch.
fn ignoring(of: ImagePair) -> ImagePair {
    let patches = of.width.div_ceil(PATCH) * (of.image.len() / of.width).div_ceil(PATCH);
    ImagePair {
        ignored: (0..patches).map(|patch| patch % 3 == 1).collect(),
        ..of
    }
}

/// The same under an exposure, with clipped and dark values in both.
fn exposed(mut of: ImagePair, gain: [f32; 3]) -> ImagePair {
    for (i, (image, photo)) in of.image.iter_mut().zip(&mut of.rgba).enumerate() {
        match i % 7 {
            0 => *photo = [255, 254, 253, photo[3]],
            1 => *photo = [0, 1, 2, photo[3]],
            2 => *image = image.map(|x| f64::from((0.05 * x) as f32)),
            _ => {}
        }
    }
    ImagePair { gain: Some(gain), ..of }
}

/// The same with a quarter of the windows.
fn lattice(of: ImagePair, offset: [usize; 2]) -> ImagePair {
    ImagePair {
        stride: 2,
        offset,
        ..of
    }
}

/// The same with an alpha by position.
fn alpha(mut of: ImagePair, alpha: impl Fn(usize, usize) -> u8) -> ImagePair {
    for (i, pixel) in of.rgba.iter_mut().enumerate() {
        pixel[3] = alpha(i % of.width, i / of.width);
    }
    of
}

/// A photograph and a render in shades by column.
fn paint(width: usize, photo: impl Fn(usize) -> u8, image: impl Fn(usize) -> f64) -> ImagePair {
    let mut of = noisy(width, 20, Composite);
    for (i, pixel) in of.rgba.iter_mut().enumerate() {
        *pixel = [photo(i % width); 4];
        pixel[3] = 255;
        of.image[i] = [f64::from(image(i % width) as f32); 3];
    }
    of
}

fn comparisons() -> Vec<(&'static str, ImagePair)> {
    let corner = |x: usize, y: usize| match x < 20 && y < 9 {
        true => 0,
        false => (x * 7 % 256) as u8,
    };
    let edge = |x: usize| if x < 20 { 0 } else { 255 };
    let above_a_tile = noisy(TILE[0] + 1, TILE[1] + 1, Composite);
    let gains = [1.335, 0.7492, 1.02];
    vec![
        ("one pixel", noisy(1, 1, Composite)),
        ("smaller than the window", noisy(5, 3, Composite)),
        ("one tile", noisy(TILE[0], TILE[1], Composite)),
        ("a pixel more than a tile", above_a_tile),
        ("several tiles", noisy(50, 107, Composite)),
        ("composited", alpha(noisy(40, 33, Composite), corner)),
        ("masked", alpha(noisy(40, 33, Mask), corner)),
        ("masked out", alpha(noisy(18, 18, Mask), |_, _| 0)),
        ("a bright flat field", paint(40, |_| 250, |_| 0.97)),
        ("a hard edge", paint(40, edge, |x| if x < 19 { 0.02 } else { 0.96 })),
        ("a perfect match", paint(20, |_| 255, |_| 1.0)),
        ("exposed", exposed(noisy(37, 60, Composite), gains)),
        ("exposed and masked", exposed(alpha(noisy(40, 33, Mask), corner), gains)),
        ("a lattice of one window", lattice(noisy(1, 1, Composite), [0, 0])),
        ("a lattice without windows", lattice(noisy(1, 1, Composite), [1, 1])),
        ("a small lattice", lattice(noisy(5, 3, Composite), [1, 0])),
        ("a lattice over tiles", lattice(noisy(50, 107, Composite), [0, 1])),
        (
            "a masked lattice",
            lattice(exposed(alpha(noisy(41, 33, Mask), corner), gains), [1, 1]),
        ),
        ("without patches", ignoring(noisy(50, 107, Composite))),
        ("masked, without patches", ignoring(alpha(noisy(40, 33, Mask), corner))),
        ("the same exposure", exposed(noisy(20, 20, Composite), [1.0; 3])),
    ]
}

const WORKGROUPS: Workgroups = Workgroups::any(&[8, 32, 64, 128]);

#[test]
fn tiles_are_compared() {
    let gpu = device::gpu();
    let mut check = Check::new("loss");
    let comparisons = comparisons();
    for with_ssim in [true, false] {
        let case = |of| compare(&gpu, of, with_ssim).unwrap();
        let usual = comparisons.iter().filter(|(_, of)| with_ssim || of.stride == 1);
        let cases: Vec<_> = usual.map(|(name, of)| (*name, case(of))).collect();
        check.cases(&gpu, WORKGROUPS, &cases);
    }
    check.finish();
}

#[test]
fn pixels_get_their_gradient() {
    let gpu = device::gpu();
    let mut check = Check::new("loss_backward");
    let comparisons = comparisons();
    for lambda in [LAMBDA, 0.0] {
        let case = |of| differentiate(&gpu, of, lambda).unwrap();
        let usual = comparisons.iter().filter(|(_, of)| lambda > 0.0 || of.stride == 1);
        let cases: Vec<_> = usual.map(|(name, of)| (*name, case(of))).collect();
        check.cases(&gpu, WORKGROUPS, &cases);
    }
    check.finish();
}

#[test]
fn tiles_are_added_up() {
    let gpu = device::gpu();
    let mut check = Check::new("loss_sum");
    for places in [WHOLE, [1, 2, 2]] {
        check.cases(&gpu, ELEMENTWISE, &by_length(|len| sum(&gpu, len, places)));
    }
    check.finish();
}

#[test]
fn gains_have_their_sums() {
    let gpu = device::gpu();
    let mut check = Check::new("loss_exposure");
    let comparisons = comparisons();
    let case = |of| expose(&gpu, of).unwrap();
    let cases: Vec<_> = comparisons.iter().map(|(name, of)| (*name, case(of))).collect();
    check.cases(&gpu, WORKGROUPS, &cases);
    check.finish();
}

#[test]
fn patches_have_their_residuals() {
    let gpu = device::gpu();
    let mut check = Check::new("loss_residual");
    let comparisons = comparisons();
    let case = |of| residual(&gpu, of).unwrap();
    let cases: Vec<_> = comparisons.iter().map(|(name, of)| (*name, case(of))).collect();
    check.cases(&gpu, WORKGROUPS, &cases);
    check.finish();
}
