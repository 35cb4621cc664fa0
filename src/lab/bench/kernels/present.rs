//! Case of `present`: a composited image written into a rectangle of a storage image of our own.

use super::KernelCase;
use crate::Result;
use crate::gpu::Gpu;
use crate::kernels::present::{Bindings, Params, Present, groups};
use crate::lab::bench::Work;
use crate::lab::bench::check::{Output, floats};
use crate::lab::bench::input::random::Random;
use crate::layout::View;

/// Column and row of a case's first pixel in its image.
pub(super) const ORIGIN: [u32; 2] = [3, 2];

/// Extent of an image around a rectangle of `size` pixels from [`ORIGIN`] on, with a column and a row beyond.
pub(super) fn extent_around(size: [u32; 2]) -> [u32; 2] {
    [size[0] + ORIGIN[0] + 1, size[1] + ORIGIN[1] + 1]
}

/// Values of that image, with NaN around the rectangle, and the rectangle's pixels by their index.
pub(super) fn values_around(size: [u32; 2], pixel: impl Fn(usize) -> [f64; 4]) -> Vec<f64> {
    let [width, height] = extent_around(size);
    let at = |x: u32, y: u32| {
        let [x, y] = [x.checked_sub(ORIGIN[0])?, y.checked_sub(ORIGIN[1])?];
        (x < size[0] && y < size[1]).then(|| pixel((y * size[0] + x) as usize))
    };
    let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    all.flat_map(|(x, y)| at(x, y).unwrap_or([f64::NAN; 4])).collect()
}

/// Four planes of random numbers to an image of `size` pixels. Transmittance becomes opacity.
pub fn present<'a>(gpu: &Gpu, size: [u32; 2]) -> Result<KernelCase<'a, Present>> {
    let pixels = (size[0] * size[1]) as usize;
    let random = &mut Random::new(size[0].into());
    let mut value = || random.between(-0.5, 1.5) as f32;
    let planes: Vec<f32> = (0..4 * pixels).map(|_| value()).collect();
    let view = View {
        size,
        ..View::default()
    };
    let view = gpu.buffer_from("view", &[view])?;
    let image = gpu.buffer_from("image", &planes)?;
    // Pixels around the rectangle must not be touched.
    let target = gpu.image("target", extent_around(size))?;
    let expected = values_around(size, |i| {
        let plane = |plane: usize| planes[plane * pixels + i];
        [plane(0), plane(1), plane(2), 1.0 - plane(3)].map(f64::from)
    });
    let (cleared, found) = (target.clone(), target.clone());
    let work = Work::of(pixels, "pixels").moving(2 * 16 * pixels);
    let case = KernelCase::new(work)
        .before(move |rec, _| rec.clear(&cleared, f32::NAN))
        .judge(move |gpu| {
            let found = floats(&gpu.download_image(&found)?);
            Ok(vec![Output::exact("pixels", found, expected.clone())])
        });
    Ok(case.commands(move |rec, kernel: &Present, _| {
        let io = Bindings {
            view: &view,
            image: &image,
            target: &target,
        };
        kernel.record(rec, io, Params { origin: ORIGIN }, groups(size));
    }))
}
